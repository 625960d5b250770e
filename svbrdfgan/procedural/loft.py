"""The vehicle body's surface: cross-sections of the outline, joined along the length and closed at both ends."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray
from scipy.ndimage import gaussian_filter1d

from svbrdfgan.procedural.outline import Outline

SIDE_ROWS, TOP_ROWS = 11, 6
"""Number of rows of a half cross-section: from the sill to the roof's edge, and from there to the centre line."""

_UNDER_ROWS = 3
_CAP_SCALES = (0.75, 0.45, 0.0)
_STATIONS = 32
_DENSE = 256


def loft(
    outline: Outline, extra_stations: ndarray
) -> tuple[Float[ndarray, "vertices 3"], Int[ndarray, "faces 3"], ndarray]:
    """Vertices, outward faces, and a mask of the faces of the underside. Welding makes the surface closed."""
    sections = [_section(outline, float(z)) for z in _stations(outline, extra_stations)]
    rings = np.stack([_closed(section) for section in sections])
    rings = np.concatenate([_cap(rings[0])[::-1], rings, _cap(rings[-1])])
    count, size, _ = rings.shape
    i, j = np.meshgrid(np.arange(count - 1), np.arange(size), indexing="ij")
    a, b = i * size + j, i * size + (j + 1) % size
    quads = np.stack([a, b, b + size, a + size], axis=-1).reshape(-1, 4)
    middle = (count - 1) / 2  # quad diagonals are mirrored about the middle plane, so that the body is symmetric
    flip = ((j >= size // 2) ^ (i > middle)).ravel()[:, None]
    first = np.where(flip, quads[:, [0, 1, 2]], quads[:, [0, 1, 3]])
    second = np.where(flip, quads[:, [0, 2, 3]], quads[:, [1, 2, 3]])
    ends = (i < len(_CAP_SCALES)) | (i >= count - 1 - len(_CAP_SCALES))
    under = (~ends & (np.minimum(j, size - 1 - j) < _UNDER_ROWS)).ravel()
    return rings.reshape(-1, 3), np.concatenate([first, second]), np.concatenate([under, under])


def _stations(outline: Outline, extra: ndarray) -> Float[ndarray, " stations"]:
    """z of the cross-sections: denser where the side view is steep or curved and at the ends; `extra` is included."""
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
    """Half a cross-section at `z`, from the centre of the underside along the side to the centre of the top."""
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
    """The half curve with its corner rounded over `radius`, resampled to the rows of a cross-section.

    Args:
        corner: index of the roof's edge in `half`.
        missing: length that a wheel arch removes from the curve's lower end.
    """
    step = np.linalg.norm(np.diff(half, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(step)])
    even = np.linspace(0.0, along[-1], _DENSE)
    curve = np.stack([np.interp(even, along, half[:, k]) for k in range(2)], axis=1)
    # The other half is appended so that the smoothing does not put a kink on the centre line.
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

    Above a wheel arch `length` is less than the `whole` height. The lower rows are then compressed more than the upper
    ones, so that the upper rows stay straight along the vehicle.
    """
    share = (1.0 - np.linspace(0.0, 1.0, SIDE_ROWS + 1)) ** 1.15
    lost = 1.0 - length / whole
    power = np.clip(0.85 / max(lost, 1e-6) - 1.0, 0.0, 2.0)  # a larger power would make rows cross
    return whole * share * (1.0 - lost * share**power)


def _closed(half: Float[ndarray, "rows 3"]) -> Float[ndarray, "ring 3"]:
    """The closed ring: the half section and its mirror image, without duplicates of the two points at x = 0."""
    return np.concatenate([half, half[-2:0:-1] * (-1.0, 1.0, 1.0)])


def _cap(ring: Float[ndarray, "ring 3"]) -> Float[ndarray, "caps ring 3"]:
    """Copies of the end ring that shrink to a point and so close the body."""
    centre = np.array([0.0, 0.5 * (ring[:, 1].min() + ring[:, 1].max()), ring[0, 2]])
    return np.stack([centre + scale * (ring - centre) for scale in _CAP_SCALES])
