"""The body's skin: cross-sections of the outline, joined along the length and closed at both ends."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray
from scipy.ndimage import gaussian_filter1d

from svbrdfgan.procedural.outline import Outline

SIDE_ROWS, TOP_ROWS = 11, 6
"""Steps of a cross-section from the sill to the roof's edge, and from there to the middle."""

_UNDER_ROWS = 3
_CAP_SCALES = (0.75, 0.45, 0.0)
_STATIONS = 32
_DENSE = 256


def loft(
    outline: Outline, extra_stations: ndarray
) -> tuple[Float[ndarray, "vertices 3"], Int[ndarray, "faces 3"], ndarray]:
    """Vertices, outward faces, and for each face whether it belongs to the underside; a closed surface once welded."""
    sections = [_section(outline, float(z)) for z in _stations(outline, extra_stations)]
    rings = np.stack([_closed(section) for section in sections])
    rings = np.concatenate([_cap(rings[0])[::-1], rings, _cap(rings[-1])])
    count, size, _ = rings.shape
    i, j = np.meshgrid(np.arange(count - 1), np.arange(size), indexing="ij")
    a, b = i * size + j, i * size + (j + 1) % size
    quads = np.stack([a, b, b + size, a + size], axis=-1).reshape(-1, 4)
    middle = (count - 1) / 2  # diagonals mirror each other about the middle plane and lean with the rounding
    flip = ((j >= size // 2) ^ (i > middle)).ravel()[:, None]
    first = np.where(flip, quads[:, [0, 1, 2]], quads[:, [0, 1, 3]])
    second = np.where(flip, quads[:, [0, 2, 3]], quads[:, [1, 2, 3]])
    ends = (i < len(_CAP_SCALES)) | (i >= count - 1 - len(_CAP_SCALES))
    under = (~ends & (np.minimum(j, size - 1 - j) < _UNDER_ROWS)).ravel()
    return rings.reshape(-1, 3), np.concatenate([first, second]), np.concatenate([under, under])


def _stations(outline: Outline, extra: ndarray) -> Float[ndarray, " stations"]:
    """Places along the body, dense where the side view is steep or bends and at the rounded ends, and at `extra`."""
    z = np.linspace(-0.5, 0.5, 1001)
    slope = np.abs(np.gradient(outline.top(z), z))
    bend = np.abs(np.gradient(np.arctan(slope), z))
    density = 1.0 + np.minimum(0.8 * slope, 4.0) + np.minimum(0.06 * bend, 2.0) + 3.0 * (np.abs(z) > 0.45)
    cumulative = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))])
    spread = np.interp(np.linspace(0.0, cumulative[-1], _STATIONS), cumulative, z)
    fixed = np.sort(extra)
    inside = [np.abs(spread - axle) < outline.arch_radius for axle in outline.shape.axles]
    close = np.min(np.abs(spread[:, None] - fixed), axis=1) < 0.011
    ends = np.abs(spread) > 0.499
    return np.unique(np.concatenate([spread[ends | ~(close | np.any(inside, axis=0))], fixed]))


def _section(outline: Outline, z: float) -> Float[ndarray, "rows 3"]:
    """Half a cross-section, from the middle of the underside around to the middle of the top."""
    place = np.array(z)
    low, floor, top = float(outline.low(place)), float(outline.floor(place)), float(outline.top(place))
    crown = min(0.04 * outline.shape.width, 0.2 * (top - low))
    y = np.linspace(low, top - crown, _DENSE)
    side = np.stack([outline.half_width(place, y), y], axis=1)
    x = np.linspace(side[-1, 0], 0.0, _DENSE)[1:]
    roof = np.stack([x, top - crown * (x / side[-1, 0]) ** 2], axis=1)
    curve = _rounded(np.concatenate([side, roof]), outline.shape.rounding, len(side) - 1, low - floor)
    inner = max(curve[0, 0] - 1.5 * outline.shape.wheel_width, 0.0)
    under = np.array([(0.0, floor), (inner, floor), (inner, low)])
    points = np.concatenate([under, curve])
    return np.insert(points, 2, z, axis=1)


def _rounded(half: Float[ndarray, "points 2"], radius: float, corner: int, missing: float) -> Float[ndarray, "rows 2"]:
    """The curve with its corner softened over `radius`, resampled to the rows of a section.

    `missing` is the length that a wheel arch cuts from its start.
    """
    step = np.linalg.norm(np.diff(half, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(step)])
    even = np.linspace(0.0, along[-1], _DENSE)
    curve = np.stack([np.interp(even, along, half[:, k]) for k in range(2)], axis=1)
    mirrored = np.concatenate([curve, curve[-2::-1] * (-1.0, 1.0)])
    sigma = min(radius, 0.12 * along[-1]) / (even[1] - even[0])
    pad = int(4 * sigma) + 1
    padded = np.pad(mirrored, ((pad, pad), (0, 0)), mode="reflect", reflect_type="odd")
    smooth = gaussian_filter1d(padded, sigma, axis=0)[pad : pad + _DENSE]
    smooth[-1, 0] = 0.0
    side = along[corner] - _spread(along[corner], along[corner] + missing)
    top = along[corner] + (along[-1] - along[corner]) * np.linspace(0.0, 1.0, TOP_ROWS + 1)[1:] ** 1.25
    rows = np.concatenate([side, top])
    return np.stack([np.interp(rows, even, smooth[:, k]) for k in range(2)], axis=1)


def _spread(length: float, whole: float) -> Float[ndarray, " rows"]:
    """Distances of a side's rows from its upper end, from `length` down to 0.

    Over an arch, where `length` is less than the `whole` height, the lower rows give way more than the upper ones,
    so that rows run straight past it.
    """
    share = (1.0 - np.linspace(0.0, 1.0, SIDE_ROWS + 1)) ** 1.15
    lost = 1.0 - length / whole
    power = np.clip(0.85 / max(lost, 1e-6) - 1.0, 0.0, 2.0)  # beyond this the rows would cross
    return whole * share * (1.0 - lost * share**power)


def _closed(half: Float[ndarray, "rows 3"]) -> Float[ndarray, "ring 3"]:
    """The half section followed by its mirror image, without repeating the two middle points."""
    return np.concatenate([half, half[-2:0:-1] * (-1.0, 1.0, 1.0)])


def _cap(ring: Float[ndarray, "ring 3"]) -> Float[ndarray, "caps ring 3"]:
    """Rings that close the body at its end, shrinking to a point."""
    centre = np.array([0.0, 0.5 * (ring[:, 1].min() + ring[:, 1].max()), ring[0, 2]])
    return np.stack([centre + scale * (ring - centre) for scale in _CAP_SCALES])
