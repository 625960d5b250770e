"""The numbers of a run, with their meaning in words."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from svbrdfgan.config.distributions import values_of
from svbrdfgan.data.index import INDEX, DatasetIndex
from svbrdfgan.evaluation.evaluate import Evaluated
from svbrdfgan.evaluation.record import Evaluation
from svbrdfgan.training.config import TrainConfig
from svbrdfgan.training.run import RunConfig

MetricsLog = list[dict[str, float]]
HELD_OUT = {"train": "Training vehicles", "validation": "Validation vehicles", "test": "Held-out vehicles"}


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
    """The figures at the head of the page; unknown ones are left out."""
    found = [
        KeyFigure(
            "recovered",
            f"{evaluation.recovered:.3f}",
            "How much of the true layers the generator learned from pictures alone: "
            "1 is all of it, 0 no better than one colour everywhere.",
        )
    ]
    if evaluation.resemblance is not None and evaluation.draws is not None:
        least = evaluation.draws.least
        meaning = (
            "How alike draws of the generator are to draws of the true layers: 1 is as alike as true draws are to each "
            f"other, 0 one colour everywhere. Least alike: {least}, {evaluation.draws.parts[least]:.2f}. Recovered is "
            "that of one draw, and says little."
        )
        found.insert(0, KeyFigure("resemblance", f"{evaluation.resemblance:.3f}", meaning))
    if evaluation.draws_oracle is not None:
        found[1:1] = _resemblance_of_the_oracle(evaluation)
    if evaluation.oracle is not None:
        found.append(KeyFigure("oracle", f"{evaluation.oracle:.3f}", _oracle_meaning(evaluation)))
    if evaluation.fraction is not None:
        meaning = "Recovered as a share of the oracle: what learning from pictures costs."
        found.append(KeyFigure("of the oracle", f"{evaluation.fraction:.0%}", meaning))
    found.append(
        KeyFigure(
            "FLIP",
            f"{evaluation.flip:.3f}",
            "How different renders look from the stored pictures, to the eye: 0 is no difference at all.",
        )
    )
    if evaluation.relit_flip is not None:
        found.append(KeyFigure("relit FLIP", f"{evaluation.relit_flip:.3f}", _relit_meaning(evaluation)))
    found.append(
        KeyFigure(
            "area seen",
            f"{evaluation.seen:.0%}",
            "The share of the learnable area that some picture shows; only that is scored.",
        )
    )
    half = half_way(evaluation, config, log)
    return found if half is None else [*found, half]


def _resemblance_of_the_oracle(evaluation: Evaluation) -> list[KeyFigure]:
    """The resemblance that the oracle of a distribution reached, and the run's share of it."""
    best, part = evaluation.draws_oracle, evaluation.resemblance_fraction
    assert best is not None
    meaning = (
        "The same network trained adversarially on true layers instead of pictures, for as many steps. Least alike: "
        f"{best.least}, {best.parts[best.least]:.2f}."
    )
    found = [KeyFigure("resemblance of the oracle", f"{best.resemblance:.3f}", meaning)]
    if part is not None:
        meaning = "Resemblance as a share of the oracle's: what learning from pictures costs."
        found.append(KeyFigure("resemblance, of the oracle", f"{part:.0%}", meaning))
    return found


def half_way(evaluation: Evaluation, config: TrainConfig, log: MetricsLog) -> KeyFigure | None:
    """Images and time until the validation score passed half the oracle's; None if it never did or is unknown."""
    if evaluation.oracle_validation is None:
        return None
    for line in log:
        if line.get("recovered", -1.0) >= evaluation.oracle_validation / 2 > 0:
            images = line["step"] * config.images_per_step
            took = duration(line["seconds"])
            return KeyFigure(
                "images to half",
                f"{images:,.0f}",
                f"Seen until the validation score passed half the oracle's, in {took}.",
            )
    return None


def flip_bars(evaluation: Evaluation) -> list[Bar]:
    """FLIP of the pictures under each layer."""
    found = (evaluation.flip_constant, evaluation.flip, evaluation.flip_oracle, evaluation.flip_truth)
    return _bars(*found)


def relit_bars(evaluation: Evaluation) -> list[Bar]:
    """Relit FLIP under each layer; none where it was not measured."""
    its = evaluation
    return _bars(its.relit_flip_constant, its.relit_flip, its.relit_flip_oracle, its.relit_flip_truth)


def _bars(constant: float | None, learned: float | None, oracle: float | None, truth: float | None) -> list[Bar]:
    values = {
        "best constant layer": constant,
        "learned": learned,
        "oracle": oracle,
        "truth itself (noise alone)": truth,
    }
    known = {name: value for name, value in values.items() if value is not None}
    longest = max([*known.values(), 1e-9])  # all may be 0
    return [Bar(name, f"{value:.3f}", 100 * (value / longest)) for name, value in known.items()]


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
    entries.append(("texture", f"{dataset.texture} x {dataset.texture}"))
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


def _oracle_meaning(evaluation: Evaluation) -> str:
    ceiling = "The same network trained on the true layers themselves: the ceiling."
    steps = "" if evaluation.oracle_steps is None else f" after {evaluation.oracle_steps:,} steps"
    if evaluation.oracle_plateau is None:
        return f"One draw of the same network trained{steps} on true layers instead of pictures; says as little."
    if evaluation.oracle_plateau:
        return f"{ceiling} At its plateau{steps}."
    return f"{ceiling} Still rising{steps}, so the true ceiling is higher."


def _counts(plan: DatasetIndex | None, evaluation: Evaluation) -> str:
    """Vehicles of each split; if the data set is gone, those of the scored split and its pictures."""
    if plan is None:
        return f"{evaluation.subjects} {evaluation.split} in {evaluation.exemplars} pictures"
    return ", ".join(f"{len(plan.meshes[split])} {split}" for split in plan.config.splits)


def find_plan(config: RunConfig) -> DatasetIndex | None:
    """The plan of the run's data set; None if the data set is gone."""
    folder = Path(config.dataset_folder)
    return DatasetIndex.load(folder) if (folder / INDEX).is_file() else None
