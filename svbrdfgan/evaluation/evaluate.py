"""Evaluates a run: what its generator recovered on subjects that it never saw, compared with an oracle."""

from __future__ import annotations

import logging
from collections import defaultdict
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

import torch
from jaxtyping import Float
from lightning_fabric import Fabric
from torch import Tensor

from svbrdfgan.data.conditions import labels_of_scenes
from svbrdfgan.data.config import Split
from svbrdfgan.data.index import INDEX, Dataset
from svbrdfgan.errors import AssetError
from svbrdfgan.evaluation.adversarial_oracle import Budget
from svbrdfgan.evaluation.close_up import close_ups
from svbrdfgan.evaluation.distribution import Comparison, compare_draws
from svbrdfgan.evaluation.evaluated import Evaluated, LayersOf, by_subject, pictures
from svbrdfgan.evaluation.findings import Findings
from svbrdfgan.evaluation.observable_texels import Observation
from svbrdfgan.evaluation.oracle import LoadedSplit, OracleConfig, oracle_of
from svbrdfgan.evaluation.record import Painter
from svbrdfgan.evaluation.relight import Relight, Relighter
from svbrdfgan.evaluation.relit_draws import DrawRelighter
from svbrdfgan.metrics.constant_layer import constant_layers
from svbrdfgan.metrics.flip import display as as_displayed
from svbrdfgan.metrics.flip import flip
from svbrdfgan.metrics.recovered import Observed, Scorer
from svbrdfgan.networks.draw import Draw
from svbrdfgan.networks.generator import Generator
from svbrdfgan.plugins.select import resolve_renderer
from svbrdfgan.rendering.checked_renderer import CheckedRenderer
from svbrdfgan.training.batches import BatchSource, load_seen_texels, make_batch_source
from svbrdfgan.training.memory import require_run
from svbrdfgan.training.resolve import ResolvedRun, make_fabric, seeds_vary
from svbrdfgan.training.run import RunConfig, load_model
from svbrdfgan.types import Layer
from svbrdfgan.utils.devices import Device
from svbrdfgan.utils.display import Display, SilentDisplay

log = logging.getLogger(__name__)


def evaluate(
    run: Path,
    *,
    split: Split = "test",
    oracle: bool = True,
    device: Device = "auto",
    dataset: Path | None = None,
    on: Path | None = None,
    schedule: OracleConfig | None = None,
    budget: Budget | None = None,
    relight: Relight | None = None,
    workers: int = 1,
    display: Display | None = None,
) -> Evaluated:
    """Scores a run on a split and writes `evaluation.json`; trains the oracle first if the run has none yet.

    Args:
        dataset: the folder of the run's data set, if it was moved.
        on: the folder of another data set to score it on, such as that of photographs' true layers; without oracle,
            which would be that of other exemplars.
        schedule: how a supervised oracle is trained.
        budget: how long the oracle of a distribution is trained; by default as many steps as the run, and at most the
            time that the run was allowed.
        relight: the scenes for relit FLIP; by default two for each vehicle, in procedural skies and rooms.
        workers: processes that paint the true layers which draws are compared with. More than one are spawned, so they
            import the caller's main module.

    Raises:
        AssetError: the folder is no run or has no model yet, or its data set or that split is missing.
        ConfigError: the data set is another one, or `on` has other maps or conditions; training used a light to relight
            with; torch finds no such device; or more memory is needed than may be taken.
    """
    shown = display or SilentDisplay()
    fabric = make_fabric(device)
    model = load_model(run)
    if on is None:
        opened = _open_dataset(model.config, dataset)
        config = model.config if dataset is None else model.config.moved(opened)
    else:
        opened = Dataset.open(on)
        config = model.config.scored_on(opened)
    relighter = Relighter.make(relight or Relight(), opened.index)  # its mistakes are found before anything slow
    resolved = ResolvedRun(config.train, opened).unperturbed()
    require_run(resolved, ("train",) if split == "train" else ("train", split), fabric.device, learns=False)
    if resolved.deferred:  # pictures are compared with exemplars, and have all of their samples
        resolved = resolved.with_config(rendering="online")
    renderer, _ = resolve_renderer(config.train.renderer, fabric.device, config.maps, differentiable=True)

    as_exemplars = resolved.with_config(spp=config.dataset.spp)  # FLIP compares with the exemplars
    source = make_batch_source(as_exemplars, split, renderer, fabric.device, shown)

    @cache
    def other(of: Split) -> LoadedSplit:
        return load_seen_texels(resolved, of, renderer, shown.advance)

    def load(of: Split) -> LoadedSplit:
        """A split. Whoever asks which texels its pictures show traces its scenes, so each call begins that phase."""
        if of == split:
            return source.exemplars, source.seen
        shown.begin(f"light transport of the {of} scenes", len(opened.index.sampler(of)))
        return other(of)

    constants = constant_layers(*load("train"), fabric.device)
    observed = _observed(source, renderer, config, shown)
    scorer = Scorer.make(source.exemplars, source.seen, constants, fabric.device, observed)
    learned = _layers(fabric, scorer, model.generator, config.conditions.typical())
    layers: dict[Painter, Tensor] = {"generated": learned, "constant": constants[0].expand_as(learned)}
    drawing: dict[Painter, Generator] = {"generated": model.generator}
    found = None
    if oracle and on is None:
        found = oracle_of(run, fabric, config, load, constants, schedule or OracleConfig(), budget, shown)
        labels = config.conditions.typical() if found.adversarial else ()
        layers["oracle"] = _layers(fabric, scorer, found.generator, labels)
        if found.adversarial:
            drawing["oracle"] = found.generator
    layers_of = _with_own_conditions(by_subject(source.exemplars, layers), drawing, config, fabric, source)
    flips, draws = _flips(source, layers_of, shown), Comparison()
    if model.generator.varies or seeds_vary(config.dataset):
        pictured = DrawRelighter.make(relighter, source.exemplars, opened.index.sampler(split), renderer)
        draws = _draws(drawing, config, fabric, source, scorer, constants, workers, pictured, shown)
    relit = relighter.relit(source.exemplars, opened.index.sampler(split), renderer, layers_of, shown)
    evaluation = Findings(scorer, constants, layers, flips, relit.flips, draws).evaluation(split, found)
    evaluation.save(run)
    near = close_ups(source.exemplars, renderer, layers_of) if model.generator.varies else ()
    return Evaluated(evaluation, config, source, layers, layers_of, relit.scenes, near, model.generator)


def _draws(
    generators: Mapping[Painter, Generator],
    config: RunConfig,
    fabric: Fabric,
    source: BatchSource,
    scorer: Scorer,
    constants: Tensor,
    workers: int,
    relighter: DrawRelighter,
    shown: Display,
) -> Comparison:
    """The scores of draws; none if the true draws cannot be compared."""
    shown.begin("comparing draws of layers", len({target.subject for target in scorer.targets}))
    try:
        return compare_draws(
            generators,
            config,
            fabric,
            source.exemplars,
            scorer,
            constants,
            shown.advance,
            workers=workers,
            relighter=relighter,
        )
    except AssetError as error:
        log.warning("resemblance has no score: %s", error)
        return Comparison(refusal=str(error) if seeds_vary(config.dataset) else "")


def _observed(source: BatchSource, renderer: CheckedRenderer, config: RunConfig, shown: Display) -> Observed | None:
    """The texels where the split's further maps can be observed; None if layers paint base_color alone."""
    if not config.maps:
        return None
    shown.begin("where each map can be observed", len(_weathered(source)))
    return Observation(source.exemplars, renderer, shown.advance)


def _weathered(source: BatchSource) -> list[int]:
    return [index for index in range(len(source)) if source.exemplars.weathered(index)]


def _open_dataset(config: RunConfig, moved_to: Path | None) -> Dataset:
    """The run's data set, opened where it is now."""
    if moved_to is None and not (Path(config.dataset_folder) / INDEX).is_file():
        raise AssetError(
            f"the run's data set is no longer {config.dataset_folder}: say where it is, with --dataset, or make it "
            "again."
        )
    return Dataset.open(moved_to or Path(config.dataset_folder))


def _layers(
    fabric: Fabric, scorer: Scorer, generator: Generator, labels: Sequence[float] = ()
) -> Float[Tensor, "subjects rows cols channels"]:
    """One layer of each subject; of a generator with random fields, that of seed 0."""
    with fabric.autocast():
        return scorer.layers(Draw(generator.to(fabric.device), labels=labels).on)


def _with_own_conditions(
    layers_of: LayersOf, generators: Mapping[Painter, Generator], config: RunConfig, fabric: Fabric, source: BatchSource
) -> LayersOf:
    """The same layers, but those of generators with conditions by seed 0 and the exemplar's own amount and recipe."""
    if not config.conditions.size:
        return layers_of

    def layers(index: int) -> dict[Painter, Layer]:
        labels = labels_of_scenes(config.conditions, [source.exemplars.scenes[index]])
        assert labels is not None
        found, inputs = layers_of(index), source.inputs([index])
        with torch.no_grad(), fabric.autocast():
            drawn = {name: Draw(each, 0, labels[0].tolist()).on(inputs)[0].float() for name, each in generators.items()}
        return found | {name: Layer(values, generators[name].maps) for name, values in drawn.items()}

    return layers


def _flips(source: BatchSource, layers_of: LayersOf, shown: Display) -> dict[Painter, float]:
    """Mean FLIP between the exemplars and pictures of the same scenes under each painter's layers."""
    totals: dict[Painter, float] = defaultdict(float)
    weathered = _weathered(source)
    shown.begin("comparing pictures", len(weathered))
    for index in weathered:
        truth = as_displayed(source.exemplars.images[index], coverage=source.exemplars.coverage[index].float())
        layers = layers_of(index)
        for name, picture in zip(layers, pictures(source, index, layers.values()), strict=True):
            totals[name] += flip(truth, picture)
        shown.advance(1)
    return {name: total / max(len(weathered), 1) for name, total in totals.items()}
