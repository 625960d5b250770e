"""Distortion of lengths, angles and areas, from the singular values of each triangle's linear map.

The linear map is that from the unit square to the surface, as in Sander, Snyder, Gortler and Hoppe (2001). Its singular
values Gamma >= gamma are the greatest and the least stretch of a unit length of the square. They are divided by
sqrt(area on the surface / area in the square), so the scale of the map does not matter and an isometry scores 1.0 in
every measure. Mirroring does not matter either; `layout` measures it.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan.geometry.normals import uv_areas
from svbrdfgan.metrics.uv.visibility import VisibleSurface

_THINNEST = 1e-6  # of the square's side: the stretch of thinner faces is dominated by the rounding of UVs to float32


@dataclass(frozen=True)
class Distortion:
    """Distortion measures, weighted by area on the surface. 1.0 is no distortion; infinity means that all collapsed.

    Attributes:
        stretch_l2: sqrt(mean((Gamma^2 + gamma^2) / 2)): L2 stretch (Sander et al. 2001).
        stretch_linf: the greatest Gamma: L-infinity stretch (Sander et al. 2001).
        stretch_p99: the 99th percentile of Gamma, robust to a few slivers.
        angle_mean, angle_p99: (Gamma / gamma + gamma / Gamma) / 2: half the MIPS energy of Hormann and Greiner (2000).
        area_mean, area_p99: (a + 1 / a) / 2, with a = Gamma gamma: the area term of Degener, Meseth and Klein (2003).
        collapsed: share of the area whose triangles are a line or a point in UV, or thinner than a millionth of the
            square. The other measures ignore them, because their stretch is infinite or noise.
    """

    stretch_l2: float
    stretch_linf: float
    stretch_p99: float
    angle_mean: float
    angle_p99: float
    area_mean: float
    area_p99: float
    collapsed: float


def singular_values(
    corners: Float[ndarray, "faces 3 3"], uv: Float[ndarray, "faces 3 2"]
) -> tuple[Float[ndarray, " faces"], Float[ndarray, " faces"]]:
    """Gamma and gamma of the linear map from the square to each triangle; not normalised; infinite if collapsed."""
    p, q = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    twice = 2.0 * uv_areas(uv)
    longest = np.max([np.linalg.norm(e, axis=1) for e in (p, q, q - p)], axis=0)
    good = np.abs(twice) > _THINNEST * longest
    e, f = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    scale = np.where(good, twice, 1.0)[:, None]
    by_u, by_v = (q[:, 1:] * e - p[:, 1:] * f) / scale, (p[:, :1] * f - q[:, :1] * e) / scale
    a, b, c = ((m * n).sum(axis=1) for m, n in ((by_u, by_u), (by_u, by_v), (by_v, by_v)))
    largest = np.sqrt((a + c) / 2 + np.hypot((a - c) / 2, b))
    least = np.linalg.norm(np.cross(by_u, by_v), axis=1) / np.where(largest > 0, largest, 1.0)
    return np.where(good, largest, np.inf), np.where(good, least, np.inf)


def face_stretch(visible: VisibleSurface) -> tuple[Float[ndarray, " faces"], Float[ndarray, " faces"]]:
    """Gamma and gamma of each face, normalised by the total areas of the faces that are not collapsed."""
    largest, least = singular_values(visible.positions[visible.faces], visible.uv)
    good = np.isfinite(largest)
    on_surface, in_square = visible.areas[good].sum(), np.abs(visible.uv_areas[good]).sum()
    scale = np.sqrt(in_square / on_surface) if on_surface > 0 else 1.0
    return largest * scale, least * scale


def distortion(visible: VisibleSurface) -> Distortion:
    """The distortion measures of a visible surface."""
    largest, least = face_stretch(visible)
    weights = visible.areas
    good = np.isfinite(largest) & (weights > 0)
    collapsed = float(weights[~np.isfinite(largest)].sum() / max(weights.sum(), 1e-300))
    if not good.any():
        return Distortion(inf, inf, inf, inf, inf, inf, inf, collapsed)
    largest, least, weights = largest[good], least[good], weights[good] / weights[good].sum()
    angle = (largest / least + least / largest) / 2
    size = (largest * least + 1 / (largest * least)) / 2
    return Distortion(
        stretch_l2=float(np.sqrt(weights @ (largest**2 + least**2) / 2)),
        stretch_linf=float(largest.max()),
        stretch_p99=percentile(largest, weights),
        angle_mean=float(weights @ angle),
        angle_p99=percentile(angle, weights),
        area_mean=float(weights @ size),
        area_p99=percentile(size, weights),
        collapsed=collapsed,
    )


def percentile(values: Float[ndarray, " n"], weights: Float[ndarray, " n"], share: float = 0.99) -> float:
    """Weighted percentile: the least value such that it and all smaller values have this share of the weight."""
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order[min(np.searchsorted(total, share * total[-1] * (1 - 1e-12)), len(order) - 1)]])
