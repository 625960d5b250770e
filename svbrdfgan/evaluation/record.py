"""The score of a run on a split: the contents of `evaluation.json`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Literal

from svbrdfgan.config.models import StrictModel
from svbrdfgan.data.config import Split
from svbrdfgan.io.records import save_record
from svbrdfgan.metrics.draw_figures import DrawFigures
from svbrdfgan.metrics.resemblance import Resemblance

Painter = Literal["generated", "oracle", "constant", "truth"]
"""Whoever painted layers: the generator, the oracle, the best constant, or G0, whose layers are the truth."""

EVALUATION = "evaluation.json"
LEAST_AREA = 0.2
"""The least share of the learnable area on which a map's score says something of a vehicle."""


def of_split(name: str, split: Split) -> str:
    """The name of a file for a split: `report.html` tells of the test split, `report.validation.html` of validation."""
    stem, suffix = name.split(".")
    return name if split == "test" else f"{stem}.{split}.{suffix}"


class MapScore(StrictModel):
    """The score of one map of the composited material.

    Attributes:
        recovered: 1 - E / E(constant); None where the truth is constant or the map can be observed nowhere.
        error: E, the mean absolute error; of `normal`, the mean angle in degrees. None where the map can be observed
            nowhere.
    """

    recovered: float | None = None
    error: float | None = None


class PainterScores(StrictModel):
    """The scores of the layers of one painter.

    Attributes:
        flip: mean FLIP between pictures under the layers and the stored exemplars; of the truth, what noise alone makes
            of it.
        relit_flip: mean FLIP between fresh pictures under the layers and under G0's own, in lights and from views that
            training never had. None where no picture was relit.
        figures: alpha of draws compared with true ones, where layers are a distribution; of the truth, other true
            draws.
    """

    flip: float
    relit_flip: float | None = None
    figures: DrawFigures | None = None


class ConstantScores(PainterScores):
    """The scores of the best constant.

    Attributes:
        layer: the layer of least error in base_color on the training subjects.
        errors: for each map, E of its own constant layer; None where the map can be observed nowhere.
    """

    layer: tuple[float, float, float, float]
    errors: dict[str, float | None] = {}


class LearnedScores(PainterScores):
    """The scores of a trained network.

    Attributes:
        recovered: 1 - E / E(constant) on the split, in base_color.
        recovered_at_poles: the same near the poles of the hemispherical map, the nose and tail of a vehicle, where the
            thesis saw artifacts; comparable across embeddings.
        maps: where layers paint further maps, the scores of all maps, base_color among them.
        draws: where layers are a distribution, how alike the network's draws are to true ones
            (`svbrdfgan.metrics.resemblance`); then `recovered` and FLIP are those of one draw, and say little.
    """

    recovered: float
    recovered_at_poles: float | None = None
    maps: dict[str, MapScore] = {}
    draws: Resemblance | None = None

    @property
    def resemblance(self) -> float | None:
        """The resemblance of `draws`."""
        return None if self.draws is None else self.draws.resemblance

    def of_map(self, name: str) -> MapScore:
        """The score of a map; one without numbers if the map was not scored."""
        return self.maps.get(name, MapScore())


class OracleScores(LearnedScores):
    """The scores of the oracle.

    Attributes:
        plateau: whether the oracle had stopped improving. None if the run learns a distribution: then the oracle is
            trained adversarially on true layers, and `recovered` is that of one draw of it.
        validation: what the oracle recovered on the validation split, by which it was chosen; with further maps, the
            mean over all maps.
    """

    steps: int
    plateau: bool | None = None
    validation: float | None = None

    @property
    def state(self) -> str:
        """The end of a supervised oracle's training, in words."""
        return "at its plateau" if self.plateau else "still rising"


class Evaluation(StrictModel):
    """The contents of `evaluation.json`; of other splits than `test`, `evaluation.SPLIT.json`.

    Attributes:
        areas: for each map, the share of the learnable area that is scored: that the split's pictures show, and where
            the map can be observed.
        oracle: None if there is no oracle.
        refusal: why the draws of a distribution could not be compared; else empty.
    """

    split: Split
    subjects: int
    exemplars: int
    areas: dict[str, float]
    generated: LearnedScores
    oracle: OracleScores | None = None
    constant: ConstantScores
    truth: PainterScores
    refusal: str = ""

    @property
    def of_distribution(self) -> bool:
        """Whether layers are a distribution: no single layer is right, and only sets of draws can be compared."""
        return self.generated.draws is not None or bool(self.refusal)

    @property
    def painters(self) -> dict[Painter, PainterScores]:
        """The scores of all painters there are."""
        oracle: dict[Painter, PainterScores] = {} if self.oracle is None else {"oracle": self.oracle}
        return {"truth": self.truth, "generated": self.generated, **oracle, "constant": self.constant}

    @property
    def seen(self) -> float:
        """Share of the learnable area that the split's pictures show; only that is scored."""
        return self.areas["base_color"]

    @property
    def fraction(self) -> float | None:
        """Recovered over that of the oracle; None of a distribution, where both are those of one draw."""
        return None if self.of_distribution else self.of_oracle(lambda its: its.recovered)

    @property
    def relit_ratio(self) -> float | None:
        """Relit FLIP of the generator over that of the oracle: 1 is as good as the network can be."""
        return self.of_oracle(lambda its: its.relit_flip)

    @property
    def resemblance_fraction(self) -> float | None:
        """Resemblance over that of the oracle."""
        return self.of_oracle(lambda its: its.resemblance)

    @property
    def half_way(self) -> float:
        """Half of what the oracle recovered on the validation split; 0 if that is unknown."""
        return 0.0 if self.oracle is None else (self.oracle.validation or 0.0) / 2

    def of_oracle(self, score: Callable[[LearnedScores], float | None]) -> float | None:
        """A score of the generator over that of the oracle; None if there is none, or `share` has none."""
        return None if self.oracle is None else share(score(self.generated), score(self.oracle))

    def lines(self) -> list[str]:
        """The scores in words, one line each, and a table of the maps; of a distribution, those of draws alone."""
        return self._draw_lines() if self.of_distribution else self._layer_lines()

    def _layer_lines(self) -> list[str]:
        scored = f"{self.subjects} {self.split} subjects, {self.seen:.0%} of their area seen"
        mine, best = self.generated, self.oracle
        lines = [f"recovered: {mine.recovered:.3f} ({scored})"]
        if best is not None:
            lines.append(f"oracle:    {best.recovered:.3f} ({best.state} after {best.steps} steps)")
        if self.fraction is not None:
            lines.append(f"fraction:  {self.fraction:.3f} of the oracle")
        if mine.recovered_at_poles is not None:
            lines.append(f"at poles:  {mine.recovered_at_poles:.3f}")
            if best is not None and best.recovered_at_poles is not None:
                lines[-1] += f" (oracle {best.recovered_at_poles:.3f})"
        lines.append(
            f"FLIP:      {mine.flip:.3f} (constant layer {self.constant.flip:.3f}, noise alone {self.truth.flip:.3f})"
        )
        return lines + self._relit_lines() + self._map_lines()

    def map_table(self) -> dict[str, dict[str, str]]:
        """The cells of the table of maps, by map and heading; empty where base_color is the only map."""
        return {name: self._cells(name) for name in self.generated.maps}

    def little_observed(self) -> list[str]:
        """A warning for each map that is scored on less than a fifth of the learnable area."""
        return [
            f"{name} can be observed on only {self.areas[name]:.0%} of the learnable area: its score says little."
            for name in self.generated.maps
            if self.areas[name] < LEAST_AREA
        ]

    def save(self, run: Path) -> None:
        save_record(run / of_split(EVALUATION, self.split), self)

    def _draw_lines(self) -> list[str]:
        """The scores of draws. The names of painters are those of `painters`."""
        mine, compared = self.generated.draws, f"{self.subjects} {self.split} subjects, {self.seen:.0%} of their area"
        if mine is None:
            return [f"resemblance: unknown, since {self.refusal}"]
        lines = [*mine.lines(), f"compared:    {mine.draws} draws of each of {compared}"]
        if self.oracle is not None and (best := self.oracle.draws) is not None:
            least = f"{best.least} {best.parts[best.least]:.2f}"
            lines.append(f"oracle:      {best.resemblance:.3f} (least: {least}; {self.oracle.steps} steps)")
        if self.resemblance_fraction is not None:
            lines.append(f"fraction:    {self.resemblance_fraction:.3f} of the oracle")
        return lines + [f"{name}: {its.figures.line()}" for name, its in self.painters.items() if its.figures]

    def _relit_lines(self) -> list[str]:
        found = {name: f"{its.relit_flip:.3f}" for name, its in self.painters.items() if its.relit_flip is not None}
        if "generated" not in found:
            return []
        best = f"oracle {found['oracle']}, " if "oracle" in found else ""
        ratio = "" if self.relit_ratio is None else f", {self.relit_ratio:.2f} times the oracle's"
        others = f"{best}constant layer {found['constant']}, noise alone {found['truth']}"
        return [f"relit:     FLIP {found['generated']}{ratio} ({others})"]

    def _map_lines(self) -> list[str]:
        table = self.map_table()
        if not table:
            return []
        rows = [("map", *next(iter(table.values()))), *((name, *cells.values()) for name, cells in table.items())]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        aligned = ["  ".join(word.ljust(w) for word, w in zip(row, widths, strict=True)).rstrip() for row in rows]
        return aligned + self.little_observed()

    def _cells(self, name: str) -> dict[str, str]:
        form, unit = (".1f", " degrees") if name == "normal" else (".3f", "")
        mine, best = self.generated.of_map(name), None if self.oracle is None else self.oracle.of_map(name).recovered

        def cell(value: float | None, form: str = ".3f", unit: str = "") -> str:
            return "-" if value is None else f"{value:{form}}{unit}"

        return {
            "recovered": cell(mine.recovered),
            "oracle": cell(best),
            "fraction": cell(share(mine.recovered, best)),
            "error": cell(mine.error, form, unit),
            "of the constant": cell(self.constant.errors.get(name), form, unit),
            "area": cell(self.areas[name], ".0%"),
        }


def share(learned: float | None, oracle: float | None) -> float | None:
    """A number over the oracle's; None where either is unknown, or the oracle's is not positive."""
    return learned / oracle if learned is not None and oracle is not None and oracle > 0 else None
