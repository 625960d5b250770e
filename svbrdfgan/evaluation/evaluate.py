"""The verdict on a run: what its generator recovered on subjects that it never saw, beside what an oracle could."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from jaxtyping import Float
from lightning_fabric import Fabric
from torch import Tensor

from svbrdfgan.config.models import StrictModel
from svbrdfgan.data.config import Split
from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.data.index import PLAN
from svbrdfgan.errors import AssetError
from svbrdfgan.evaluation.oracle import OracleConfig, train_oracle
from svbrdfgan.io.atomic import atomic_path
from svbrdfgan.io.records import save_record
from svbrdfgan.metrics.flip import display as as_displayed
from svbrdfgan.metrics.flip import flip
from svbrdfgan.metrics.recovered import Scorer, SeenTexels, constant_layer, make_targets, mean_errors
from svbrdfgan.networks import Generator
from svbrdfgan.rendering.compositing import RGBA
from svbrdfgan.scene.loader import resolve_renderer
from svbrdfgan.training.batches import Feed, buffers_of, make_feed, make_seen
from svbrdfgan.training.config import ScenesConfig
from svbrdfgan.training.run import ORACLE, ORACLE_NOTES, RunConfig, load_generator, load_model, save_generator
from svbrdfgan.training.trainer import auto_precision, require_device
from svbrdfgan.utils.display import Display, Silent

EVALUATION = "evaluation.json"
_ORACLE_TARGETS = 2048


def of_split(name: str, split: Split) -> str:
    """The name of a file for a split: `report.html` tells of the test split, `report.validation.html` of validation."""
    stem, suffix = name.split(".")
    return name if split == "test" else f"{stem}.{split}.{suffix}"


Pictured = tuple[Exemplars, SeenTexels]
"""A split, and what its pictures show."""

log = logging.getLogger(__name__)


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
        """What to tell a user."""
        scored = f"{self.subjects} {self.split} subjects, {self.seen:.0%} of their area seen"
        told = [f"recovered: {self.recovered:.3f} ({scored})"]
        if self.oracle is not None:
            plateau = "at its plateau" if self.oracle_plateau else "still rising"
            told.append(f"oracle:    {self.oracle:.3f} ({plateau} after {self.oracle_steps} steps)")
        if self.fraction is not None:
            told.append(f"fraction:  {self.fraction:.3f} of the oracle")
        if self.recovered_at_poles is not None:
            best = "" if self.oracle_at_poles is None else f" (oracle {self.oracle_at_poles:.3f})"
            told.append(f"at poles:  {self.recovered_at_poles:.3f}{best}")
        told.append(
            f"FLIP:      {self.flip:.3f} (constant layer {self.flip_constant:.3f}, noise alone {self.flip_truth:.3f})"
        )
        return told + [f"{name}: {error:.3f} mean absolute error" for name, error in self.maps.items()]

    def save(self, run: Path) -> None:
        save_record(run / of_split(EVALUATION, self.split), self)


@dataclass(frozen=True, eq=False)
class Evaluated:
    """A verdict and what pictures of it need.

    Attributes:
        layers: by name ("generated", "oracle", "constant"), what is painted on each subject.
    """

    evaluation: Evaluation
    config: RunConfig
    feed: Feed
    layers: dict[str, Float[Tensor, "subjects rows cols channels"]]


def evaluate(
    run: Path,
    *,
    split: Split = "test",
    oracle: bool = True,
    device: Literal["auto", "cpu", "cuda"] = "auto",
    dataset: Path | None = None,
    schedule: OracleConfig | None = None,
    display: Display | None = None,
) -> Evaluated:
    """Scores a run on a split, training the oracle first if the run has none yet, and writes `evaluation.json`.

    Args:
        dataset: where the run's data set is now, if it was moved.

    Raises:
        AssetError: no run, no model yet, no data set where it was, or no such split.
        ConfigError: the data set is another, or the device cannot be had.
    """
    shown = display or Silent()
    require_device(device)
    model = load_model(run)
    if dataset is not None:
        model = replace(model, config=model.config.moved(dataset))
    elif not (Path(model.config.dataset_folder) / PLAN).is_file():
        was = model.config.dataset_folder
        raise AssetError(f"the run's data set is no longer {was}: say where it is, with --dataset, or make it anew.")
    config = model.config.train.model_copy(update={"scenes": ScenesConfig()})  # the exemplars' own
    fabric = Fabric(accelerator=device, devices=1, precision=auto_precision(device))
    renderer, _ = resolve_renderer(config.renderer, fabric.device, model.config.maps, differentiable=True)
    folder = Path(model.config.dataset_folder)

    shown.begin(f"light transport of the {split} scenes")
    judged = config.model_copy(update={"spp": model.config.dataset.spp})  # pictures are compared with exemplars
    scored = make_feed(judged, folder, split, renderer, fabric.device, progress=shown.advance)

    @cache
    def pictured(of: Split) -> Pictured:
        if of == split:
            return scored.exemplars, scored.seen
        shown.begin(f"light transport of the {of} scenes")
        return make_seen(config, folder, of, renderer, shown.advance)

    constant = constant_layer(*pictured("train"), fabric.device)
    scorer = Scorer.make(scored.exemplars, scored.seen, constant, fabric.device)
    layers = {"generated": _layers(fabric, scorer, model.generator)}
    found = None
    if oracle:
        found = _oracle(run, fabric, model.config, pictured, constant, schedule or OracleConfig(), shown)
        layers["oracle"] = _layers(fabric, scorer, found.generator)
    layers["constant"] = constant.expand_as(layers["generated"])
    shown.begin("comparing pictures", len(scored))
    evaluation = _judge(split, scorer, layers, found, constant, _flips(scored, layers, shown))
    further = mean_errors(scorer.targets, layers["generated"])[1:]
    evaluation = evaluation.model_copy(update={"maps": dict(zip(model.config.maps, further, strict=True))})
    evaluation.save(run)
    return Evaluated(evaluation, model.config, scored, layers)


@dataclass(frozen=True, eq=False)
class _Found:
    """An oracle, trained now or before."""

    generator: Generator
    score: float | None
    plateau: bool
    steps: int


def _oracle(
    run: Path,
    fabric: Fabric,
    config: RunConfig,
    pictured: Callable[[Split], Pictured],
    constant: Tensor,
    schedule: OracleConfig,
    shown: Display,
) -> _Found:
    """The run's oracle; where there is none, trained now, its plateau judged on the validation split."""
    path, notes = run / ORACLE, run / ORACLE_NOTES
    if path.is_file() and notes.is_file():
        told = json.loads(notes.read_text(encoding="utf-8"))
        generator, score = load_generator(path)
        return _Found(generator.to(fabric.device), score, told["plateau"], told["steps"])
    trained, seen = pictured("train")
    targets, _ = make_targets(trained, seen, fabric.device, _ORACLE_TARGETS)
    held_out = pictured("validation") if "validation" in config.dataset.splits else (trained, seen)
    scorer = Scorer.make(*held_out, constant, fabric.device)
    shown.begin("training the supervised oracle")

    def watch(step: int, score: float) -> None:
        shown.advance(schedule.every, f"recovered {score:.3f}")

    oracle = train_oracle(fabric, config.train, buffers_of(trained, fabric.device), targets, scorer, schedule, watch)
    save_generator(path, oracle.generator, config.train.generator, oracle.score)
    with atomic_path(notes) as temporary:
        temporary.write_text(json.dumps({"plateau": oracle.plateau, "steps": oracle.steps}), encoding="utf-8")
    return _Found(oracle.generator, oracle.score, oracle.plateau, oracle.steps)


def _judge(
    split: Split,
    scorer: Scorer,
    layers: dict[str, Tensor],
    oracle: _Found | None,
    constant: Tensor,
    flips: dict[str, float],
) -> Evaluation:
    recovered = scorer.recovered_by(layers["generated"])
    best = scorer.recovered_by(layers["oracle"]) if oracle else None
    ends = scorer.at_poles(constant)
    red, green, blue, alpha = constant[:RGBA].tolist()
    return Evaluation(
        split=split,
        recovered=recovered,
        oracle=best,
        fraction=share(recovered, best),
        recovered_at_poles=ends.recovered_by(layers["generated"]) if ends else None,
        oracle_at_poles=ends.recovered_by(layers["oracle"]) if ends and oracle else None,
        oracle_validation=oracle.score if oracle else None,
        oracle_plateau=oracle.plateau if oracle else None,
        oracle_steps=oracle.steps if oracle else None,
        flip=flips["generated"],
        flip_oracle=flips.get("oracle"),
        flip_constant=flips["constant"],
        flip_truth=flips["truth"],
        seen=scorer.seen,
        constant=(red, green, blue, alpha),
        subjects=len(scorer.geometry),
        exemplars=len(scorer.targets),
    )


def share(recovered: float, oracle: float | None) -> float | None:
    """Recovered as a share of the oracle's; None where there is no oracle or it recovered nothing."""
    return recovered / oracle if oracle is not None and oracle > 0 else None


def _layers(fabric: Fabric, scorer: Scorer, generator: Generator) -> Float[Tensor, "subjects rows cols channels"]:
    with fabric.autocast():
        return scorer.layers(generator.to(fabric.device))


def _flips(feed: Feed, layers: dict[str, Tensor], shown: Display) -> dict[str, float]:
    """Mean FLIP between the exemplars and pictures of the same scenes under each set of layers, and under G0's own."""
    totals = dict.fromkeys([*layers, "truth"], 0.0)
    weathered = [index for index in range(len(feed)) if feed.exemplars.weathered(index)]
    for index in weathered:
        truth = as_displayed(feed.exemplars.images[index], coverage=feed.exemplars.coverage[index].float())
        for name, picture in pictures(feed, index, layers).items():
            totals[name] += flip(truth, picture)
        shown.advance(1)
    return {name: total / max(len(weathered), 1) for name, total in totals.items()}


def pictures(feed: Feed, index: int, layers: dict[str, Tensor]) -> dict[str, Float[Tensor, "height width 3"]]:
    """An exemplar's scene as displayed, under each set of layers and under G0's own ("truth")."""
    subject = int(feed.exemplars.subject_of[index])
    stage = feed.stage([index], np.random.default_rng(0))
    chosen: dict[str, Any] = {name: painted[subject] for name, painted in layers.items()}
    chosen["truth"] = feed.exemplars.layers[index]
    shown = {}
    for name, layer in chosen.items():
        if layer is not None:
            with torch.no_grad():
                image, coverage = stage.render(layer.unsqueeze(0).to(feed.buffers.device))
            shown[name] = as_displayed(image[0].cpu(), coverage=coverage[0].cpu().float())
    return shown
