"""The score of a run on a split: the contents of `evaluation.json`."""

from __future__ import annotations

from pathlib import Path

from svbrdfgan.config.models import StrictModel
from svbrdfgan.data.config import Split
from svbrdfgan.io.records import save_record

EVALUATION = "evaluation.json"


def of_split(name: str, split: Split) -> str:
    """The name of a file for a split: `report.html` tells of the test split, `report.validation.html` of validation."""
    stem, suffix = name.split(".")
    return name if split == "test" else f"{stem}.{split}.{suffix}"


class Evaluation(StrictModel):
    """The contents of `evaluation.json`; of other splits than `test`, `evaluation.SPLIT.json`.

    Attributes:
        recovered, oracle: 1 - E / E(constant) of the generator and of the supervised oracle, on the split.
        fraction: recovered / oracle, where the oracle recovered anything.
        recovered_at_poles, oracle_at_poles: the same near the poles of the hemispherical map, the nose and tail of a
            vehicle, where the thesis saw artifacts; comparable across embeddings.
        oracle_validation: what the oracle recovered on the validation split, by which it was chosen.
        oracle_plateau: whether the oracle had stopped improving.
        flip, flip_oracle, flip_constant: mean FLIP between pictures under the layers and the stored exemplars; what
            noise alone makes of it is `flip_truth`, with G0's own layers.
        seen: share of the learnable area that the split's pictures show; only that is scored.
        constant: the layer of least error on the training subjects.
        maps: mean absolute error of the generator in each further map that layers paint.
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
    seen: float
    constant: tuple[float, float, float, float]
    subjects: int
    exemplars: int
    maps: dict[str, float] = {}

    def lines(self) -> list[str]:
        """The scores in words, one line each."""
        scored = f"{self.subjects} {self.split} subjects, {self.seen:.0%} of their area seen"
        lines = [f"recovered: {self.recovered:.3f} ({scored})"]
        if self.oracle is not None:
            plateau = "at its plateau" if self.oracle_plateau else "still rising"
            lines.append(f"oracle:    {self.oracle:.3f} ({plateau} after {self.oracle_steps} steps)")
        if self.fraction is not None:
            lines.append(f"fraction:  {self.fraction:.3f} of the oracle")
        if self.recovered_at_poles is not None:
            best = "" if self.oracle_at_poles is None else f" (oracle {self.oracle_at_poles:.3f})"
            lines.append(f"at poles:  {self.recovered_at_poles:.3f}{best}")
        lines.append(
            f"FLIP:      {self.flip:.3f} (constant layer {self.flip_constant:.3f}, noise alone {self.flip_truth:.3f})"
        )
        return lines + [f"{name}: {error:.3f} mean absolute error" for name, error in self.maps.items()]

    def save(self, run: Path) -> None:
        save_record(run / of_split(EVALUATION, self.split), self)


def share(recovered: float, oracle: float | None) -> float | None:
    """Recovered as a share of the oracle's; None where there is no oracle or it recovered nothing."""
    return recovered / oracle if oracle is not None and oracle > 0 else None
