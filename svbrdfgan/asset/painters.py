"""What paints weathering at any point of a user's mesh."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan.asset.points import SurfacePoints
from svbrdfgan.asset.surroundings import Surroundings
from svbrdfgan.weathering.recipes import Recipe


@dataclass(frozen=True, eq=False)
class Paint:
    """Weathering at points.

    Attributes:
        color: linear RGB in [0, 1].
        alpha: straight alpha in [0, 1], for all maps.
        roughness, metallic: in [0, 1].
        height: of the relief, in metres along the outward normal.
    """

    color: Float[ndarray, "points 3"]
    alpha: Float[ndarray, " points"]
    roughness: Float[ndarray, " points"]
    metallic: Float[ndarray, " points"]
    height: Float[ndarray, " points"]


class Painter(Protocol):
    """Paints points of one mesh, each by itself: how points are grouped does not matter."""

    def __call__(self, points: SurfacePoints, texel: float) -> Paint:
        """The weathering at points that lie about `texel` metres apart."""


@dataclass(frozen=True, eq=False)
class RecipePainter:
    """Paints by a procedural recipe, which needs no embedding: it has no seam, and reaches every point."""

    surroundings: Surroundings
    recipe: Recipe

    def __call__(self, points: SurfacePoints, texel: float) -> Paint:
        site = self.surroundings.site(points, texel)
        coat = self.recipe.paint(site)
        height = coat.height * self.recipe.relief * self.surroundings.grounds.length
        return Paint(coat.color, coat.alpha, coat.roughness, coat.metallic, np.asarray(height))
