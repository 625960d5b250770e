"""The score of a run on a split: the contents of `evaluation.json`."""

from __future__ import annotations

from pathlib import Path

from svbrdfgan.config.models import StrictModel
from svbrdfgan.data.config import Split
from svbrdfgan.io.records import save_record
from svbrdfgan.metrics.draw_figures import DrawFigures
from svbrdfgan.metrics.resemblance import Resemblance

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
        recovered, oracle: 1 - E / E(constant) of the generator and of the oracle; None where the truth is constant or
            the map can be observed nowhere.
        fraction: recovered / oracle, where the oracle recovered anything.
        error, constant_error: E of the generator and of the map's constant layer: mean absolute error; of `normal`, the
            mean angle in degrees.
        area: share of the learnable area that is scored: that pictures show, and where the map can be observed.
    """

    recovered: float | None = None
    oracle: float | None = None
    fraction: float | None = None
    error: float | None = None
    constant_error: float | None = None
    area: float | None = None

    def beside(self, oracle: float | None) -> MapScore:
        """The same score, with what an oracle recovered."""
        return self.model_copy(update={"oracle": oracle, "fraction": share(self.recovered, oracle)})


class Evaluation(StrictModel):
    """The contents of `evaluation.json`; of other splits than `test`, `evaluation.SPLIT.json`.

    Attributes:
        recovered, oracle: 1 - E / E(constant) of the generator and of the supervised oracle, on the split, in
            base_color.
        fraction: recovered / oracle, where the oracle recovered anything.
        recovered_at_poles, oracle_at_poles: the same near the poles of the hemispherical map, the nose and tail of a
            vehicle, where the thesis saw artifacts; comparable across embeddings.
        oracle_validation: what the oracle recovered on the validation split, by which it was chosen; with further maps,
            the mean over all maps.
        oracle_plateau: whether the oracle had stopped improving.
        flip, flip_oracle, flip_constant: mean FLIP between pictures under the layers and the stored exemplars; what
            noise alone makes of it is `flip_truth`, with G0's own layers.
        relit_flip, relit_flip_oracle, relit_flip_constant, relit_flip_truth: mean FLIP between fresh pictures under the
            layers and under G0's own, in lights and from views that training never had. None in records of earlier
            versions.
        seen: share of the learnable area that the split's pictures show; only that is scored.
        constant: the layer of least error on the training subjects.
        maps: where layers paint further maps, the scores of all maps, base_color among them.
        resemblance: where layers are a distribution, how alike the generator's draws are to true ones
            (`svbrdfgan.metrics.resemblance`); then `recovered` is that of one draw, and says little.
        draws: the parts of `resemblance`.
        resemblance_oracle, draws_oracle: the same of the oracle of a run that learns a distribution, which is trained
            adversarially on true layers. Then `oracle` is that of one draw of it, and there is no `fraction`.
        resemblance_fraction: resemblance / resemblance_oracle.
        figures: what draws are in alpha, compared with true ones, by what painted them: "generated", "oracle", or
            "truth", which are other true draws.
    """

    split: Split
    recovered: float
    oracle: float | None
    fraction: float | None
    recovered_at_poles: float | None = None
    oracle_at_poles: float | None = None
    oracle_validation: float | None = None
    oracle_plateau: bool | None
    oracle_steps: int | None
    flip: float
    flip_oracle: float | None
    flip_constant: float
    flip_truth: float
    relit_flip: float | None = None
    relit_flip_oracle: float | None = None
    relit_flip_constant: float | None = None
    relit_flip_truth: float | None = None
    seen: float
    constant: tuple[float, float, float, float]
    subjects: int
    exemplars: int
    maps: dict[str, MapScore] = {}
    resemblance: float | None = None
    draws: Resemblance | None = None
    resemblance_oracle: float | None = None
    draws_oracle: Resemblance | None = None
    resemblance_fraction: float | None = None
    figures: dict[str, DrawFigures] = {}

    @property
    def relit_ratio(self) -> float | None:
        """Relit FLIP of the generator over that of the oracle: 1 is as good as the network can be."""
        return share(self.relit_flip, self.relit_flip_oracle)

    def lines(self) -> list[str]:
        """The scores in words, one line each, and a table of the maps."""
        scored = f"{self.subjects} {self.split} subjects, {self.seen:.0%} of their area seen"
        lines = [f"recovered: {self.recovered:.3f} ({scored})"]
        if self.oracle is not None:
            lines.append(f"oracle:    {self.oracle:.3f} ({self._oracle_state} after {self.oracle_steps} steps)")
        if self.fraction is not None:
            lines.append(f"fraction:  {self.fraction:.3f} of the oracle")
        if self.recovered_at_poles is not None:
            best = "" if self.oracle_at_poles is None else f" (oracle {self.oracle_at_poles:.3f})"
            lines.append(f"at poles:  {self.recovered_at_poles:.3f}{best}")
        lines.append(
            f"FLIP:      {self.flip:.3f} (constant layer {self.flip_constant:.3f}, noise alone {self.flip_truth:.3f})"
        )
        return lines + self._relit_lines() + self._draw_lines() + self._map_lines()

    def little_observed(self) -> list[str]:
        """A warning for each map that is scored on less than a fifth of the learnable area."""
        return [
            f"{name} can be observed on only {score.area:.0%} of the learnable area: its score says little."
            for name, score in self.maps.items()
            if score.area is not None and score.area < LEAST_AREA
        ]

    def save(self, run: Path) -> None:
        save_record(run / of_split(EVALUATION, self.split), self)

    @property
    def _oracle_state(self) -> str:
        if self.oracle_plateau is None:
            return "one draw of it"
        return "at its plateau" if self.oracle_plateau else "still rising"

    def _draw_lines(self) -> list[str]:
        lines = self.draws.lines() if self.draws else []
        if self.draws_oracle is not None:
            least = f"{self.draws_oracle.least} {self.draws_oracle.parts[self.draws_oracle.least]:.2f}"
            lines.append(f"its oracle:  {self.resemblance_oracle:.3f} (least: {least}; {self.oracle_steps} steps)")
        if self.resemblance_fraction is not None:
            lines.append(f"fraction:    {self.resemblance_fraction:.3f} of the oracle")
        return lines + [f"{name}: {figures.line()}" for name, figures in self.figures.items()]

    def _relit_lines(self) -> list[str]:
        if self.relit_flip is None:
            return []
        best = "" if self.relit_flip_oracle is None else f"oracle {self.relit_flip_oracle:.3f}, "
        ratio = "" if self.relit_ratio is None else f", {self.relit_ratio:.2f} times the oracle's"
        others = f"{best}constant layer {self.relit_flip_constant:.3f}, noise alone {self.relit_flip_truth:.3f}"
        return [f"relit:     FLIP {self.relit_flip:.3f}{ratio} ({others})"]

    def _map_lines(self) -> list[str]:
        if not self.maps:
            return []
        heads = ("map", *map_cells("", MapScore()))
        rows = [heads, *((name, *map_cells(name, score).values()) for name, score in self.maps.items())]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        aligned = ["  ".join(word.ljust(w) for word, w in zip(row, widths, strict=True)).rstrip() for row in rows]
        return aligned + self.little_observed()


def map_cells(name: str, score: MapScore) -> dict[str, str]:
    """A row of the table of maps: by its heading, what each cell says."""
    form = ".1f" if name == "normal" else ".3f"
    unit = " degrees" if name == "normal" else ""

    def cell(value: float | None, form: str = ".3f", unit: str = "") -> str:
        return "-" if value is None else f"{value:{form}}{unit}"

    return {
        "recovered": cell(score.recovered),
        "oracle": cell(score.oracle),
        "fraction": cell(score.fraction),
        "error": cell(score.error, form, unit),
        "of the constant": cell(score.constant_error, form, unit),
        "area": cell(score.area, ".0%"),
    }


def share(learned: float | None, oracle: float | None) -> float | None:
    """A number over the oracle's; None where either is unknown, or the oracle's is not positive."""
    return learned / oracle if learned is not None and oracle is not None and oracle > 0 else None
