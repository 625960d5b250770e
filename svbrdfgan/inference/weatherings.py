"""What can weather a workpiece: a procedural recipe, or what a trained model paints."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass
from typing import Any, ClassVar, Protocol, runtime_checkable

from svbrdfgan.asset.painters import Painter, RecipePainter
from svbrdfgan.inference.workpiece import Workpiece
from svbrdfgan.types import FURTHER_MAPS
from svbrdfgan.weathering.recipes import RECIPES, Recipe
from svbrdfgan.weathering.substances import Substance


@runtime_checkable
class Weathering(Protocol):
    """One layer on any mesh."""

    @property
    def description(self) -> Mapping[str, Any]:
        """What files say of their weathering, as JSON."""

    @property
    def peak_bytes(self) -> int:
        """What its painter holds in memory at most, besides the mesh."""

    @property
    def clean(self) -> bool:
        """Whether its alpha is 0 everywhere, so that files stay as they are."""

    @property
    def settles_on(self) -> Mapping[Substance, float]:
        """What it lies on beside the parts that weather anyway, as of a `Recipe`."""

    def painter(self, workpiece: Workpiece) -> Painter:
        """Paints the layer on one mesh."""


@dataclass(frozen=True)
class RecipeWeathering:
    """Weathering by a recipe.

    Attributes:
        maps: what is painted besides base colour.
    """

    recipe: Recipe
    maps: Collection[str] = FURTHER_MAPS
    peak_bytes: ClassVar[int] = 0

    @property
    def description(self) -> Mapping[str, Any]:
        name = next(name for name, kind in RECIPES.items() if isinstance(self.recipe, kind))
        return {"recipe": name, **asdict(self.recipe)}  # type: ignore[call-overload]

    @property
    def clean(self) -> bool:
        return self.recipe.amount == 0.0

    @property
    def settles_on(self) -> Mapping[Substance, float]:
        return self.recipe.settles_on

    def painter(self, workpiece: Workpiece) -> Painter:
        return RecipePainter(workpiece.surroundings, self.recipe, self.maps)
