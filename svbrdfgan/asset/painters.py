"""What paints weathering at any point of a user's mesh."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Protocol

from jaxtyping import Float
from numpy import ndarray

from svbrdfgan.asset.points import SurfacePoints
from svbrdfgan.types import FURTHER_MAPS
from svbrdfgan.weathering.edges import SharpEdges
from svbrdfgan.weathering.recipes import Coat, Recipe
from svbrdfgan.weathering.site import Site
from svbrdfgan.weathering.survey import Grounds


@dataclass(frozen=True, eq=False)
class Paint:
    """Weathering at points.

    Attributes:
        color: linear RGB in [0, 1].
        alpha: straight alpha in [0, 1], for all maps.
        roughness, metallic: in [0, 1].
        height: of the relief, in metres along the outward normal.
        normal: unit normals of the relief in the mesh's axes, on the side of the winding's front; these are taken in
            place of the height's.
    """

    color: Float[ndarray, "points 3"]
    alpha: Float[ndarray, " points"]
    roughness: Float[ndarray, " points"]
    metallic: Float[ndarray, " points"]
    height: Float[ndarray, " points"]
    normal: Float[ndarray, "points 3"] | None = None


class Painter(Protocol):
    """Paints points of one mesh, each by itself: how points are grouped does not matter."""

    @property
    def maps(self) -> Collection[str]:
        """What is painted besides base colour, of `FURTHER_MAPS`; the paint's other maps mean nothing."""

    def __call__(self, points: SurfacePoints, texel: float) -> Paint:
        """The weathering at points that lie about `texel` metres apart."""


class Sites(Protocol):
    """What a recipe goes by at any point, as `Surroundings` find it."""

    @property
    def grounds(self) -> Grounds:
        """What all sites share."""

    @property
    def edges(self) -> SharpEdges:
        """The sharp edges of the mesh."""

    def site(self, points: SurfacePoints, texel: float, *, edges: bool = True) -> Site:
        """The site at points, `texel` metres apart."""


@dataclass(frozen=True, eq=False)
class RecipePainter:
    """Paints by a procedural recipe, which needs no embedding: it has no seam, and reaches every point."""

    surroundings: Sites
    recipe: Recipe
    maps: Collection[str] = FURTHER_MAPS

    def __post_init__(self) -> None:
        if self.recipe.reads_edges:
            _ = self.surroundings.edges  # found once, before there are threads

    def __call__(self, points: SurfacePoints, texel: float) -> Paint:
        site = self.surroundings.site(points, texel, edges=self.recipe.reads_edges)
        coat = Coat.joined(map(self.recipe.paint, site.blocks()))
        height = coat.height * self.recipe.relief * self.surroundings.grounds.length
        maps = (coat.color, coat.alpha, coat.roughness, coat.metallic, height)
        return Paint(*(values.double().cpu().numpy() for values in maps))
