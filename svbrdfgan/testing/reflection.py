"""The material of `docs/conventions.md` at points, as the kit's quadrature takes it: tilted normals and reflection."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from svbrdfgan.testing.rays import Points
from svbrdfgan.types import DIELECTRIC_REFLECTANCE, LEAST_ROUGHNESS

_LEAST = 1e-12  # below any cosine and length that matter


@dataclass(frozen=True, eq=False)
class Shades:
    """Values of the maps at points: looked up, and neither bounded nor normalised yet.

    Attributes:
        glossy: whether the material has a `roughness`; without it roughness and metallic do not count.
        normal: (0, 0, 1) where the material has none.
    """

    glossy: Bool[ndarray, " points"]
    base_color: Float[ndarray, "points 3"]
    roughness: Float[ndarray, "points 1"]
    metallic: Float[ndarray, "points 1"]
    normal: Float[ndarray, "points 3"]

    def at(self, some: slice | Bool[ndarray, " points"]) -> Shades:
        """The values at the points that `some` selects."""
        rows = (self.base_color, self.roughness, self.metallic, self.normal)
        return Shades(self.glossy[some], *(values[some] for values in rows))


def reflected(
    points: Points, shades: Shades, direction: Float[ndarray, "cells 3"]
) -> tuple[Float[ndarray, "points cells"], Float[ndarray, "points cells"]]:
    """The light that each point reflects to the viewer of unit light along each direction, times n.w_i: q and c.

    The reflection in each channel is q * base_color + c.
    """
    normal = bent(tilted(points, shades.normal), points.normal, points.to_viewer)
    cosine = normal @ direction.T
    cosine = np.where((cosine > 0.0) & (points.normal @ direction.T > 0.0), cosine, 0.0)
    rest, alone = cosine / np.pi, np.zeros_like(cosine)
    some = shades.glossy
    if some.any():
        metallic, cosine, to_viewer = shades.metallic[some], cosine[some], points.to_viewer[some]
        cosine_viewer = (normal[some] * to_viewer).sum(axis=1, keepdims=True)
        schlick, facets = gloss(cosine, cosine_viewer, to_viewer @ direction.T, shades.roughness[some])
        fresnel = DIELECTRIC_REFLECTANCE + (1.0 - DIELECTRIC_REFLECTANCE) * schlick
        facets = facets * cosine
        rest[some] = (1.0 - metallic) * (1.0 - fresnel) * rest[some] + metallic * (1.0 - schlick) * facets
        alone[some] = ((1.0 - metallic) * fresnel + metallic * schlick) * facets
    return rest, alone


def gloss(cosine: ndarray, cosine_viewer: ndarray, between: ndarray, roughness: ndarray) -> tuple[ndarray, ndarray]:
    """Schlick's p = (1 - w_o.h)^5, and S = D G / (4 n.w_i n.w_o): glTF 2.0, appendix B. `between` is w_i.w_o."""
    square = np.maximum(roughness, LEAST_ROUGHNESS) ** 4
    half = np.sqrt(np.maximum((1.0 + between) / 2.0, _LEAST))
    normal_half = (cosine + cosine_viewer) / (2.0 * half)
    spread = square / (np.pi * (normal_half**2 * (square - 1.0) + 1.0) ** 2)
    smith = [c + np.sqrt(square + (1.0 - square) * c**2) for c in (cosine, np.maximum(cosine_viewer, 0.0))]
    return (1.0 - half) ** 5, spread / (smith[0] * smith[1])


def tilted(points: Points, normal: Float[ndarray, "points 3"]) -> Float[ndarray, "points 3"]:
    """The normal map's direction in the world, of length one, and turned over where the viewer is behind."""
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    x, y, z = np.where(length > _LEAST, normal / np.maximum(length, _LEAST), [0.0, 0.0, 1.0]).T[..., None]
    return np.asarray(x * points.tangent + y * points.bitangent + z * points.normal)


def bent(
    tilted: Float[ndarray, "points 3"], normal: Float[ndarray, "points 3"], to_viewer: Float[ndarray, "points 3"]
) -> Float[ndarray, "points 3"]:
    """The tilted normal, or, where the viewer's mirror direction lies below the surface, the nearest where it does not.

    Args:
        normal: the shading normal that it was tilted from; like that, it is turned to the viewer.
    """
    a, b, c = (
        (p * q).sum(axis=1, keepdims=True) for p, q in ((tilted, normal), (to_viewer, normal), (tilted, to_viewer))
    )
    below = 2.0 * c * a < b
    excess = np.where(below, b - 2.0 * c * a, 0.0)
    pull = excess / np.maximum(a + np.sqrt(a**2 + b * excess), _LEAST)
    moved = tilted + pull * to_viewer
    return np.where(below, moved / np.maximum(np.linalg.norm(moved, axis=1, keepdims=True), _LEAST), tilted)
