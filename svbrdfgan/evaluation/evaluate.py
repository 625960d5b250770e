"""Evaluates a run: what its generator recovered on subjects that it never saw, beside a supervised oracle."""

from __future__ import annotations

import logging
import math
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from jaxtyping import Float
from lightning_fabric import Fabric
from torch import Tensor

from svbrdfgan.data.conditions import labels_of_scenes
from svbrdfgan.data.config import Split
from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.data.gather import INDEX
from svbrdfgan.data.index import Dataset
from svbrdfgan.errors import AssetError
from svbrdfgan.evaluation.adversarial_oracle import Budget
from svbrdfgan.evaluation.close_up import close_ups
from svbrdfgan.evaluation.distribution import compare_draws
from svbrdfgan.evaluation.observable_texels import Observation
from svbrdfgan.evaluation.oracle import LoadedSplit, OracleConfig, TrainedOracle, oracle_of
from svbrdfgan.evaluation.record import Evaluation, MapScore, share
from svbrdfgan.evaluation.relight import Relight, Relighter, RelitScene
from svbrdfgan.metrics.constant_layer import constant_layers
from svbrdfgan.metrics.flip import display as as_displayed
from svbrdfgan.metrics.flip import flip
from svbrdfgan.metrics.recovered import Observed, Scorer
from svbrdfgan.networks import Draw, Generator
from svbrdfgan.plugins.select import resolve_renderer
from svbrdfgan.rendering.checked_renderer import CheckedRenderer
from svbrdfgan.training.batches import BatchSource, load_seen_texels, make_batch_source
from svbrdfgan.training.resolve import ResolvedRun, make_fabric, seeds_vary
from svbrdfgan.training.run import RunConfig, load_model
from svbrdfgan.types import Layer
from svbrdfgan.utils.display import Display, SilentDisplay

log = logging.getLogger(__name__)

_RELIT = {
    "generated": "relit_flip",
    "oracle": "relit_flip_oracle",
    "constant": "relit_flip_constant",
    "truth": "relit_flip_truth",
}


LayersOf = Callable[[int], dict[str, Layer]]
"""The layers of an exemplar, by what painted them. Those of generators have the exemplar's own amount and recipe."""


@dataclass(frozen=True, eq=False)
class Evaluated:
    """The score of a run, and what pictures of it need.

    Attributes:
        config: the run's.
        source: the scored split.
        layers: the layers of each subject, by what painted them: "generated", "oracle" or "constant". A generator that
            is told conditions paints the middle amount of the first recipe.
        layers_of: the layers of an exemplar; for pictures beside it.
        relit: a few of the scenes that the run was relit in, with their pictures.
        close_ups: small parts of a few vehicles, if the generator varies.
        generator: the run's, on the device of the layers; for draws of it.
    """

    evaluation: Evaluation
    config: RunConfig
    source: BatchSource
    layers: dict[str, Float[Tensor, "subjects rows cols channels"]]
    layers_of: LayersOf
    relit: tuple[RelitScene, ...] = ()
    close_ups: tuple[RelitScene, ...] = ()
    generator: Generator | None = None


def evaluate(
    run: Path,
    *,
    split: Split = "test",
    oracle: bool = True,
    device: Literal["auto", "cpu", "cuda"] = "auto",
    dataset: Path | None = None,
    schedule: OracleConfig | None = None,
    budget: Budget | None = None,
    relight: Relight | None = None,
    workers: int = 1,
    display: Display | None = None,
) -> Evaluated:
    """Scores a run on a split and writes `evaluation.json`. It trains the oracle first if the run has none yet.

    Args:
        dataset: the folder of the run's data set, if it was moved.
        schedule: how a supervised oracle is trained.
        budget: how long the oracle of a distribution is trained; by default as many steps as the run, and at most the
            time that the run was allowed.
        relight: the scenes for relit FLIP; by default two for each vehicle, in procedural skies and rooms.
        workers: processes that paint the true layers which draws are compared with. More than one are spawned, so they
            import the caller's main module.

    Raises:
        AssetError: the folder is no run or has no model yet, or its data set or that split is missing.
        ConfigError: the data set is another one, training used a light to relight with, or torch finds no such device.
    """
    shown = display or SilentDisplay()
    fabric = make_fabric(device)
    model = load_model(run)
    opened = _open_dataset(model.config, dataset)
    config = model.config if dataset is None else model.config.moved(opened)
    relighter = Relighter.make(relight or Relight(), opened.index)  # its mistakes are found before anything slow
    resolved = ResolvedRun(config.train, opened).unperturbed()
    if resolved.deferred:  # pictures are compared with exemplars, and have all of their samples
        resolved = resolved.with_config(rendering="online")
    renderer, _ = resolve_renderer(config.train.renderer, fabric.device, config.maps, differentiable=True)

    shown.begin(f"light transport of the {split} scenes")
    as_exemplars = resolved.with_config(spp=config.dataset.spp)  # FLIP compares with the exemplars
    source = make_batch_source(as_exemplars, split, renderer, fabric.device, shown.advance)

    @cache
    def load(of: Split) -> LoadedSplit:
        if of == split:
            return source.exemplars, source.seen
        shown.begin(f"light transport of the {of} scenes")
        return load_seen_texels(resolved, of, renderer, shown.advance)

    constants = constant_layers(*load("train"), fabric.device)
    observed = _observed(source, renderer, config, shown)
    scorer = Scorer.make(source.exemplars, source.seen, constants, fabric.device, observed)
    layers = {"generated": _layers(fabric, scorer, model.generator, config.conditions.typical())}
    found = None
    if oracle:
        found = oracle_of(run, fabric, config, load, constants, schedule or OracleConfig(), budget, shown)
        labels = config.conditions.typical() if found.adversarial else ()
        layers["oracle"] = _layers(fabric, scorer, found.generator, labels)
    layers["constant"] = constants[0].expand_as(layers["generated"])
    drawing = {"generated": model.generator}
    if found is not None and found.adversarial:
        drawing["oracle"] = found.generator
    layers_of = _with_own_conditions(by_subject(source.exemplars, layers), drawing, config, fabric, source)
    shown.begin("comparing pictures", len(source))
    evaluation = _judge(split, scorer, layers, found, constants, _flips(source, layers_of, shown))
    if model.generator.varies or seeds_vary(config.dataset):
        update = _of_draws(drawing, config, fabric, source, scorer, constants, workers, shown)
        evaluation = evaluation.model_copy(update=update)
    shown.begin("comparing relit pictures")
    relit = relighter.relit(source.exemplars, opened.index.sampler(split), renderer, layers_of, shown.advance)
    evaluation = evaluation.model_copy(update={_RELIT[name]: value for name, value in relit.flips.items()})
    evaluation.save(run)
    near = close_ups(source.exemplars, renderer, layers_of) if model.generator.varies else ()
    return Evaluated(evaluation, config, source, layers, layers_of, relit.scenes, near, model.generator)


def _of_draws(
    generators: dict[str, Generator],
    config: RunConfig,
    fabric: Fabric,
    source: BatchSource,
    scorer: Scorer,
    constants: Tensor,
    workers: int,
    shown: Display,
) -> dict[str, Any]:
    """What the record says of draws; nothing if the true ones cannot be compared."""
    shown.begin("comparing draws of layers", len(scorer.geometry))
    try:
        found = compare_draws(
            generators, config, fabric, source.exemplars, scorer, constants, shown.advance, workers=workers
        )
    except AssetError as error:
        log.warning("resemblance has no score: %s", error)
        return {}
    made, best = found.resemblance["generated"], found.resemblance.get("oracle")
    told = {"resemblance": made.resemblance, "draws": made, "figures": found.figures}
    if best is None:
        return told
    oracle = {"resemblance_oracle": best.resemblance, "draws_oracle": best}
    return told | oracle | {"resemblance_fraction": share(made.resemblance, best.resemblance)}


def _observed(source: BatchSource, renderer: CheckedRenderer, config: RunConfig, shown: Display) -> Observed | None:
    """Where the split's further maps can be observed; None if layers paint base_color alone."""
    if not config.maps:
        return None
    shown.begin("where each map can be observed", len(source))
    return Observation(source.exemplars, renderer, shown.advance)


def _open_dataset(config: RunConfig, moved_to: Path | None) -> Dataset:
    """The run's data set, opened where it is now."""
    if moved_to is None and not (Path(config.dataset_folder) / INDEX).is_file():
        raise AssetError(
            f"the run's data set is no longer {config.dataset_folder}: say where it is, with --dataset, or make it "
            "again."
        )
    return Dataset.open(moved_to or Path(config.dataset_folder))


def _judge(
    split: Split,
    scorer: Scorer,
    layers: dict[str, Tensor],
    oracle: TrainedOracle | None,
    constants: Tensor,
    flips: dict[str, float],
) -> Evaluation:
    recovered = scorer.recovered_by(layers["generated"])
    best = scorer.recovered_by(layers["oracle"]) if oracle else None
    ends = scorer.at_poles(constants)
    red, green, blue, alpha = Layer(constants[0], scorer.targets[0].truth.maps).rgba.tolist()
    return Evaluation(
        split=split,
        recovered=recovered,
        oracle=best,
        fraction=None if oracle and oracle.adversarial else share(recovered, best),
        recovered_at_poles=ends.recovered_by(layers["generated"]) if ends else None,
        oracle_at_poles=ends.recovered_by(layers["oracle"]) if ends and oracle else None,
        oracle_validation=oracle.score if oracle else None,
        oracle_plateau=oracle.plateau if oracle else None,
        oracle_steps=oracle.steps if oracle else None,
        flip=flips["generated"],
        flip_oracle=flips.get("oracle"),
        flip_constant=flips["constant"],
        flip_truth=flips["truth"],
        seen=scorer.shares["base_color"],
        constant=(red, green, blue, alpha),
        subjects=len(scorer.geometry),
        exemplars=len(scorer.targets),
        maps=_map_scores(scorer, layers) if len(scorer.constant_errors) > 1 else {},
    )


def _map_scores(scorer: Scorer, layers: dict[str, Tensor]) -> dict[str, MapScore]:
    """The scores of each map, base_color among them."""
    recovered, errors = scorer.each_recovered_by(layers["generated"]), scorer.errors_by(layers["generated"])
    best = scorer.each_recovered_by(layers["oracle"]) if "oracle" in layers else dict.fromkeys(recovered)
    return {
        name: MapScore(
            recovered=recovered[name],
            oracle=best[name],
            fraction=share(recovered[name], best[name]),
            error=_known(errors[name]),
            constant_error=_known(scorer.constant_errors[name]),
            area=scorer.shares[name],
        )
        for name in recovered
    }


def _known(error: float) -> float | None:
    """None for the error of a map that can be observed nowhere, since JSON has no NaN."""
    return None if math.isnan(error) else error


def _layers(
    fabric: Fabric, scorer: Scorer, generator: Generator, labels: Sequence[float] = ()
) -> Float[Tensor, "subjects rows cols channels"]:
    """One layer of each subject; of a generator with random fields, that of seed 0."""
    with fabric.autocast():
        return scorer.layers(Draw(generator.to(fabric.device), labels=labels))


def by_subject(exemplars: Exemplars, layers: dict[str, Tensor]) -> LayersOf:
    """The layers of each exemplar's subject."""

    def layers_of(index: int) -> dict[str, Layer]:
        subject, maps = int(exemplars.subject_of[index]), tuple(exemplars.scenes[index].maps)
        return {name: Layer(painted[subject], maps) for name, painted in layers.items()}

    return layers_of


def _with_own_conditions(
    layers_of: LayersOf, generators: dict[str, Generator], config: RunConfig, fabric: Fabric, source: BatchSource
) -> LayersOf:
    """The same, but what generators paint that are told conditions: seed 0, with the exemplar's amount and recipe."""
    if not config.conditions.size:
        return layers_of

    def layers(index: int) -> dict[str, Layer]:
        labels = labels_of_scenes(config.conditions, [source.exemplars.scenes[index]])
        assert labels is not None
        found, geometry = layers_of(index), source.geometry([index])
        with torch.no_grad(), fabric.autocast():
            drawn = {name: Draw(each, 0, labels[0].tolist())(geometry)[0].float() for name, each in generators.items()}
        return found | {name: Layer(values, generators[name].maps) for name, values in drawn.items()}

    return layers


def _flips(source: BatchSource, layers_of: LayersOf, shown: Display) -> dict[str, float]:
    """Mean FLIP between the exemplars and pictures of the same scenes under each set of layers, and under G0's own."""
    totals: dict[str, float] = defaultdict(float)
    weathered = [index for index in range(len(source)) if source.exemplars.weathered(index)]
    for index in weathered:
        truth = as_displayed(source.exemplars.images[index], coverage=source.exemplars.coverage[index].float())
        for name, picture in pictures(source, index, layers_of(index)).items():
            totals[name] += flip(truth, picture)
        shown.advance(1)
    return {name: total / max(len(weathered), 1) for name, total in totals.items()}


def pictures(
    source: BatchSource, index: int, layers: Mapping[str, Layer]
) -> dict[str, Float[Tensor, "height width 3"]]:
    """Display-referred pictures of an exemplar's scene, one under each layer and one under G0's own ("truth")."""
    scenes = source.scenes([index], np.random.default_rng(0))
    shown = {}
    for name, layer in {**layers, "truth": source.exemplars.layers[index]}.items():
        if layer is not None:
            with torch.no_grad():
                image, coverage = scenes.render(layer.values.unsqueeze(0).to(source.buffers.device))
            shown[name] = as_displayed(image[0].cpu(), coverage=coverage[0].cpu().float())
    return shown
