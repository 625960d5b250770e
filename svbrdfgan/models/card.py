"""The card of a shipped model: what it paints, what it learned from, how good it is, and what it cannot do."""

from __future__ import annotations

from collections.abc import Iterator

from pydantic import Field

from svbrdfgan.config.models import StrictModel


class Source(StrictModel):
    """Data that a model learned from, and their licence."""

    name: str
    licence: str


class Scores(StrictModel):
    """Scores on vehicles that training never saw; what was not measured is left out.

    Attributes:
        vehicles: how many.
        resemblance: over all maps; 1 is as close as other true draws.
        parts: of the resemblance, by name.
        deviation: over draws, relative to the truth's.
        power: of alpha in each octave, finest first, relative to the truth's.
        normals: slopes in each octave, finest first, relative to the truth's.
        relit_flip: mean FLIP between relit draws and true ones, over that between true draws.
        amount_correlation: rank correlation of the amounts that are asked for and painted.
        amount_error: mean absolute difference in mean alpha at the same amount.
        further: any other figures, by name.
    """

    vehicles: int | None = Field(default=None, ge=1)
    resemblance: float | None = None
    parts: dict[str, float] = {}
    deviation: float | None = None
    power: tuple[float, ...] = ()
    normals: tuple[float, ...] = ()
    relit_flip: float | None = None
    amount_correlation: float | None = None
    amount_error: float | None = None
    further: dict[str, float] = {}

    def rows(self) -> Iterator[tuple[str, str]]:
        """The name and value of each figure, in words."""
        for name, value in self:
            title = name.replace("_", " ").replace("flip", "FLIP")
            if name == "further":
                yield from ((key, f"{figure:.3g}") for key, figure in self.further.items())
            elif isinstance(value, dict) and value:
                yield title, ", ".join(f"{key} {figure:.2f}" for key, figure in value.items())
            elif isinstance(value, tuple) and value:
                yield f"{title} by octave, finest first", ", ".join(f"{figure:.2f}" for figure in value)
            elif isinstance(value, float | int):
                yield title, f"{value:.3g}"


class ModelCard(StrictModel):
    """A shipped model in words and figures.

    Attributes:
        about: one sentence on what it paints.
        recipes: the procedural recipes of its exemplars.
        licence: of the weights.
        command: what trained it, for anyone to run.
        limits: sentences on what it does worse or not at all.
    """

    name: str = Field(pattern=r"^[a-z0-9]+(-[a-z0-9]+)*$")
    title: str
    about: str
    recipes: tuple[str, ...] = Field(min_length=1)
    licence: str = "Apache-2.0"
    data: tuple[Source, ...] = Field(min_length=1)
    command: str
    validation: Scores
    test: Scores
    limits: tuple[str, ...] = ()
