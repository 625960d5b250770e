"""The numbers of a run in plain words."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from svbrdfgan.data.index import INDEX, DatasetIndex
from svbrdfgan.evaluation.evaluate import Evaluated
from svbrdfgan.evaluation.record import Evaluation
from svbrdfgan.training.config import TrainConfig
from svbrdfgan.training.run import RunConfig

MetricsLog = list[dict[str, float]]
HELD_OUT = {"train": "Training vehicles", "validation": "Validation vehicles", "test": "Held-out vehicles"}


@dataclass(frozen=True)
class Figure:
    """A number of the verdict, its name, and one sentence on what it means."""

    label: str
    value: str
    meaning: str


@dataclass(frozen=True)
class Bar:
    """A number to compare by its length, in percent of the longest."""

    label: str
    value: str
    percent: float


def verdict(evaluation: Evaluation, config: TrainConfig, journal: MetricsLog) -> list[Figure]:
    """The figures at the head of the page; those that are not known are left out."""
    found = [
        Figure(
            "recovered",
            f"{evaluation.recovered:.3f}",
            "How much of the true layers the generator learned from pictures alone: "
            "1 is all of it, 0 no better than one colour everywhere.",
        )
    ]
    if evaluation.oracle is not None:
        found.append(Figure("oracle", f"{evaluation.oracle:.3f}", _oracle_meaning(evaluation)))
    if evaluation.fraction is not None:
        meaning = "Recovered as a share of the oracle: what learning from pictures costs."
        found.append(Figure("of the oracle", f"{evaluation.fraction:.0%}", meaning))
    found.append(
        Figure(
            "FLIP",
            f"{evaluation.flip:.3f}",
            "How different renders look from the stored pictures, to the eye: 0 is no difference at all.",
        )
    )
    found.append(
        Figure(
            "area seen",
            f"{evaluation.seen:.0%}",
            "Of the learnable area, what some picture shows; only that is scored.",
        )
    )
    half = half_way(evaluation, config, journal)
    return found if half is None else [*found, half]


def half_way(evaluation: Evaluation, config: TrainConfig, journal: MetricsLog) -> Figure | None:
    """Images and time until the validation score passed half the oracle's; None if it never did, or is unknown."""
    if evaluation.oracle_validation is None:
        return None
    for line in journal:
        if line.get("recovered", -1.0) >= evaluation.oracle_validation / 2 > 0:
            images = line["step"] * config.images_per_step
            took = duration(line["seconds"])
            return Figure(
                "images to half", f"{images:,.0f}", f"Seen until validation passed half the oracle, in {took}."
            )
    return None


def flip_bars(evaluation: Evaluation) -> list[Bar]:
    """FLIP under each layer, side by side."""
    values = {
        "best constant layer": evaluation.flip_constant,
        "learned": evaluation.flip,
        "oracle": evaluation.flip_oracle,
        "truth itself (noise alone)": evaluation.flip_truth,
    }
    known = {name: value for name, value in values.items() if value is not None}
    longest = max(*known.values(), 1e-9)
    return [Bar(name, f"{value:.3f}", 100 * (value / longest)) for name, value in known.items()]


def title(config: RunConfig, plan: DatasetIndex | None) -> str:
    """What was learned, and from what; without a plan, the data set is gone."""
    what = _recipe(config).replace("-", " ").capitalize()
    if plan is None:
        return f"{what}, learned from pictures"
    return f"{what}, learned from {len(plan.sampler('train')):,} pictures of {len(plan.meshes['train']):,} vehicles"


def summary(evaluated: Evaluated, plan: DatasetIndex | None, journal: MetricsLog) -> list[tuple[str, str]]:
    """What was learned, from what, and for how long."""
    config = evaluated.config
    dataset, train = config.dataset, config.train
    width, height = dataset.image
    told = [("vehicles", _counts(plan, evaluated.evaluation)), ("weathering", _recipe(config))]
    told.append(("embedding", dataset.embedding.name))
    told.append(("pictures", f"{width} x {height}, {dataset.spp} samples per pixel"))
    told.append(("texture", f"{dataset.texture} x {dataset.texture}"))
    told.append(("loss", f"{train.loss.name}, batch {train.batch_size}"))
    if journal:
        steps, seconds = journal[-1]["step"], journal[-1].get("seconds")
        images = f"{steps:,.0f} steps, {steps * train.images_per_step:,.0f} images"
        told.append(("trained", images if seconds is None else f"{images} in {duration(seconds)}"))
    return told


def _recipe(config: RunConfig) -> str:
    """What the exemplars were weathered by."""
    weathering = config.dataset.weathering
    return "unknown weathering" if weathering is None else weathering.recipe


def duration(seconds: float) -> str:
    """As people say it."""
    if seconds < 120:
        return f"{seconds:.0f} s"
    minutes = seconds / 60
    return f"{minutes:.0f} min" if minutes < 120 else f"{minutes / 60:.1f} h"


def _oracle_meaning(evaluation: Evaluation) -> str:
    ceiling = "The same network taught with the true layers themselves: the ceiling."
    steps = "" if evaluation.oracle_steps is None else f" after {evaluation.oracle_steps:,} steps"
    if evaluation.oracle_plateau:
        return f"{ceiling} At its plateau{steps}."
    return f"{ceiling} Still rising{steps}, so the true ceiling is higher."


def _counts(plan: DatasetIndex | None, judged: Evaluation) -> str:
    """Vehicles and pictures of each split; of the one that was scored, where the data set is gone."""
    if plan is None:
        return f"{judged.subjects} {judged.split} in {judged.exemplars} pictures"
    return ", ".join(f"{len(plan.meshes[split])} {split}" for split in plan.config.splits)


def find_plan(config: RunConfig) -> DatasetIndex | None:
    """What the run's data set is; None where it is gone."""
    folder = Path(config.dataset_folder)
    return DatasetIndex.load(folder) if (folder / INDEX).is_file() else None
