"""The numbers of a run, with their meaning in words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from svbrdfgan.config.distributions import values_of
from svbrdfgan.data.index import INDEX, DatasetIndex
from svbrdfgan.evaluation.evaluated import Evaluated
from svbrdfgan.evaluation.record import Evaluation, OracleScores, Painter
from svbrdfgan.training.config import TrainConfig
from svbrdfgan.training.run import RunConfig

MetricsLog = list[dict[str, float]]
HELD_OUT = {"train": "Training vehicles", "validation": "Validation vehicles", "test": "Held-out vehicles"}
_PAINTED: Mapping[Painter, str] = MappingProxyType(
    {
        "constant": "best constant layer",
        "generated": "learned",
        "oracle": "oracle",
        "truth": "truth itself (noise alone)",
    }
)


@dataclass(frozen=True)
class KeyFigure:
    """A figure at the head of the page: a number, its name, and what it means in one sentence."""

    label: str
    value: str
    meaning: str


@dataclass(frozen=True)
class Bar:
    """A number as a bar; `percent` is its length, of the longest bar."""

    label: str
    value: str
    percent: float


def verdict(evaluation: Evaluation, config: TrainConfig, log: MetricsLog) -> list[KeyFigure]:
    """The figures at the head of the page of a run that learns one layer; unknown ones are left out."""
    mine, best = evaluation.generated, evaluation.oracle
    found = [
        KeyFigure(
            "recovered",
            f"{mine.recovered:.3f}",
            "How much of the true layers the generator learned from pictures alone: "
            "1 is all of it, 0 no better than one colour everywhere.",
        ),
    ]
    if best is not None:
        found.append(KeyFigure("oracle", f"{best.recovered:.3f}", _oracle_meaning(best)))
    if evaluation.fraction is not None:
        found.append(
            KeyFigure(
                "of the oracle",
                f"{evaluation.fraction:.0%}",
                "Recovered as a share of the oracle: what learning from pictures costs.",
            )
        )
    found.append(
        KeyFigure(
            "FLIP",
            f"{mine.flip:.3f}",
            "How different renders look from the stored pictures, to the eye: 0 is no difference at all.",
        )
    )
    if mine.relit_flip is not None:
        found.append(KeyFigure("relit FLIP", f"{mine.relit_flip:.3f}", _relit_meaning(evaluation)))
    found.append(
        KeyFigure(
            "area seen",
            f"{evaluation.seen:.0%}",
            "The share of the learnable area that some picture shows; only that is scored.",
        )
    )
    half = half_way(evaluation, config, log)
    return found if half is None else [*found, half]


def half_way(evaluation: Evaluation, config: TrainConfig, log: MetricsLog) -> KeyFigure | None:
    """Images and time until the validation score passed half the oracle's; None if it never did or is unknown."""
    for line in log:
        if line.get("recovered", -1.0) >= evaluation.half_way > 0:
            return KeyFigure(
                "images to half",
                f"{line['step'] * config.images_per_step:,.0f}",
                f"Seen until the validation score passed half the oracle's, in {duration(line['seconds'])}.",
            )
    return None


def flip_bars(evaluation: Evaluation) -> list[Bar]:
    """FLIP of the pictures under each layer."""
    return _bars({painter: its.flip for painter, its in evaluation.painters.items()})


def relit_bars(evaluation: Evaluation) -> list[Bar]:
    """Relit FLIP under each layer; none where it was not measured."""
    found = {painter: its.relit_flip for painter, its in evaluation.painters.items()}
    return _bars({painter: value for painter, value in found.items() if value is not None})


def _bars(values: Mapping[Painter, float]) -> list[Bar]:
    longest = max([*values.values(), 1e-9])  # all may be 0
    known = [(label, values[painter]) for painter, label in _PAINTED.items() if painter in values]
    return [Bar(label, f"{value:.3f}", 100 * (value / longest)) for label, value in known]


def title(config: RunConfig, plan: DatasetIndex | None) -> str:
    """The report's title: what was learned from what. The plan is None if the data set is gone."""
    what = _recipe(config).replace("-", " ").capitalize()
    if plan is None:
        return f"{what}, learned from pictures"
    return f"{what}, learned from {len(plan.sampler('train')):,} pictures of {len(plan.meshes['train']):,} vehicles"


def summary(evaluated: Evaluated, plan: DatasetIndex | None, log: MetricsLog) -> list[tuple[str, str]]:
    """Labels and values: what was learned, from what, and for how long."""
    config = evaluated.config
    dataset, train = config.dataset, config.train
    width, height = dataset.image
    entries = [("vehicles", _counts(plan, evaluated.evaluation)), ("weathering", _recipe(config))]
    entries.append(("embedding", dataset.embedding.name))
    entries.append(("pictures", f"{width} x {height}, {dataset.spp} samples per pixel"))
    window = "" if dataset.window is None else f"{dataset.window} x {dataset.window} of "
    entries.append(("texture", f"{window}{dataset.texture} x {dataset.texture}"))
    entries.append(("loss", f"{train.loss.name}, batch {train.batch_size}"))
    if log:
        steps, seconds = log[-1]["step"], log[-1].get("seconds")
        images = f"{steps:,.0f} steps, {steps * train.images_per_step:,.0f} images"
        entries.append(("trained", images if seconds is None else f"{images} in {duration(seconds)}"))
    return entries


def _recipe(config: RunConfig) -> str:
    """The recipes that weathered the exemplars, or those of the model that did."""
    weathering = config.dataset.weathering
    if weathering is None:
        return "unknown weathering"
    recipes = ", ".join(values_of(weathering.recipe))
    return recipes if weathering.model is None else f"{recipes}, as a model paints it"


def duration(seconds: float) -> str:
    """The duration in seconds, minutes or hours, whichever suits."""
    if seconds < 120:
        return f"{seconds:.0f} s"
    minutes = seconds / 60
    return f"{minutes:.0f} min" if minutes < 120 else f"{minutes / 60:.1f} h"


def _relit_meaning(evaluation: Evaluation) -> str:
    ratio = evaluation.relit_ratio
    compared = "" if ratio is None else f" It is {ratio:.2f} times the oracle's."
    return f"The same in lights and from views that training never had.{compared}"


def _oracle_meaning(oracle: OracleScores) -> str:
    ceiling, after = "The same network trained on the true layers themselves: the ceiling.", f"{oracle.steps:,} steps"
    if oracle.plateau:
        return f"{ceiling} At its plateau after {after}."
    return f"{ceiling} Still rising after {after}, so the true ceiling is higher."


def _counts(plan: DatasetIndex | None, evaluation: Evaluation) -> str:
    """Vehicles of each split; if the data set is gone, those of the scored split and its pictures."""
    if plan is None:
        return f"{evaluation.subjects} {evaluation.split} in {evaluation.exemplars} pictures"
    return ", ".join(f"{len(plan.meshes[split])} {split}" for split in plan.config.splits)


def find_plan(config: RunConfig) -> DatasetIndex | None:
    """The plan of the run's data set; None if the data set is gone."""
    folder = Path(config.dataset_folder)
    return DatasetIndex.load(folder) if (folder / INDEX).is_file() else None
