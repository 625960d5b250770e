"""Training on windows: layers of close-ups alone."""

from __future__ import annotations

import gc
import math
import weakref
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from svbrdfgan.config.distributions import Fixed
from svbrdfgan.config.models import validate
from svbrdfgan.data.config import DatasetConfig
from svbrdfgan.data.exemplars import load_exemplars
from svbrdfgan.data.generate import generate
from svbrdfgan.data.index import Dataset
from svbrdfgan.errors import ConfigError
from svbrdfgan.evaluation.evaluate import evaluate
from svbrdfgan.evaluation.evaluated import by_subject, pictures
from svbrdfgan.evaluation.relight import Relight, Relighter
from svbrdfgan.networks.inputs import Inputs
from svbrdfgan.networks.saved import GeneratorConfig
from svbrdfgan.protocols import Renderer
from svbrdfgan.scene import loader
from svbrdfgan.scene.window import bordered
from svbrdfgan.training import batches, step, subject_inputs
from svbrdfgan.training.batches import BatchSource, make_batch_source
from svbrdfgan.training.config import train_config
from svbrdfgan.training.resolve import ResolvedRun, make_fabric, resolve_config, resolve_run
from svbrdfgan.training.run import RunConfig, load_model
from svbrdfgan.training.scene_batch import PreparedSurfaces
from svbrdfgan.training.subject_inputs import WindowInputs, stack_inputs
from svbrdfgan.training.trainer import train
from svbrdfgan.utils.display import SilentDisplay

Data = Callable[..., dict[str, Any]]


def close_ups(share: float = 1.0) -> dict[str, Any]:
    return {"close_ups": {"share": share, "window": 32, "distance": {"log_uniform": [0.2, 0.5]}}}


@pytest.fixture
def config(dataset_data: Data) -> DatasetConfig:
    data = dataset_data(texture=64, camera=close_ups())
    data["splits"] = {"train": {"views": 2, "meshes": {"procedural": {"count": 2}}}}
    return validate(DatasetConfig, data, "here")


LOCAL = {"norm": "pixel"}


@pytest.fixture
def run(config: DatasetConfig, training_data: Data, tmp_path: Path) -> ResolvedRun:
    generate(config, tmp_path / "data", base=tmp_path)
    return resolve_run(
        train_config(training_data(dataset=str(tmp_path / "data"), generator=LOCAL), "train.yaml"), tmp_path
    )


def source_of(run: ResolvedRun, renderer: Renderer[Any]) -> BatchSource:
    return make_batch_source(run, "train", renderer, torch.device("cpu"))


def test_each_exemplar_has_a_window_that_its_picture_shows(run: ResolvedRun, cpu_renderer: Renderer[Any]) -> None:
    source = source_of(run, cpu_renderer)
    assert source.windowed
    assert len(source.buffers) == len(source) == 4, "each has a subject of its own"
    assert source.inputs([0]).geometry.shape == (1, 6, 32, 32)
    seen = torch.stack([source.seen(index) > 0 for index in range(4)])
    assert (seen.float().mean(dim=(1, 2)) > 0.1).all()
    layers = torch.full((4, 32, 32, 4), 0.5, requires_grad=True)
    image, coverage = source.scenes(range(4), np.random.default_rng(0)).render(layers)
    assert image.shape[:3] == coverage.shape
    (gradient,) = torch.autograd.grad(image.sum(), layers)
    assert (gradient.abs().sum(dim=(1, 2, 3)) > 0.0).all()


@pytest.mark.parametrize("reads", [{}, {"mesh_maps": True}, {"refined": {}}])
def test_inputs_that_are_read_are_those_that_would_be_held(reads: dict[str, Any], run: ResolvedRun) -> None:
    exemplars = load_exemplars(run.dataset, "train", GeneratorConfig(**LOCAL, **reads))
    held, read = (make(exemplars, torch.device("cpu")) for make in (stack_inputs, batches.subject_inputs))
    assert isinstance(read, WindowInputs)
    assert len(held) == len(read) == 4
    some = WindowInputs(exemplars.subjects, torch.device("cpu"), cache_bytes=0)
    for chosen, inputs in zip(([0, 3], [2], [3, 1, 1], [0, 3]), (read, read, some, some), strict=True):
        one, other = (each.pick(exemplars.subject_of[chosen]) for each in (held, inputs))
        assert torch.equal(one.geometry, other.geometry)
        assert one.geometry.stride() == other.geometry.stride()
        assert (one.wholes is not None) == (other.wholes is not None) == ("refined" in reads)
        if one.wholes is not None and other.wholes is not None:
            wholes = [each.geometry[each.of] for each in (one.wholes, other.wholes)]
            assert torch.equal(*wholes)
            assert wholes[0].stride() == wholes[1].stride()
            assert torch.equal(one.wholes.place, other.wholes.place)


def test_only_the_last_windows_are_held(
    run: ResolvedRun, cpu_renderer: Renderer[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(loader, "KEPT", 2)
    source = source_of(run, cpu_renderer)
    some = WindowInputs(source.exemplars.subjects, torch.device("cpu"), cache_bytes=0)
    seen, read = [], []
    for index in [0, 1, 2, 3]:
        seen.append(weakref.ref(source.exemplars.subject(index).surface))
        read.append(weakref.ref(some.pick(torch.tensor([index])).geometry))
        source.scenes([index], np.random.default_rng(0))
    gc.collect()
    assert [surface() is not None for surface in seen] == [False, False, True, True]
    assert not any(geometry() is not None for geometry in read[:3])
    plain: Any = SimpleNamespace(prepare=lambda surface: surface)
    prepared = PreparedSurfaces(source.exemplars, plain)
    first = weakref.ref(prepared.of(0))
    assert prepared.of(0) is first()
    for index in [1, 2]:
        prepared.of(index)
        source.exemplars.subject(index)
    gc.collect()
    assert first() is None


def test_what_is_learned_does_not_depend_on_what_is_held(
    run: ResolvedRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    chosen = run.config.model_copy(update={"steps": 3})
    monkeypatch.setattr(loader, "KEPT", 1)
    monkeypatch.setattr(subject_inputs, "_SHARE", 0.0)
    read = train(chosen, tmp_path / "read").generator.state_dict()
    monkeypatch.setattr(loader, "KEPT", 64)
    monkeypatch.setattr(batches, "subject_inputs", stack_inputs)
    held = train(chosen, tmp_path / "held").generator.state_dict()
    assert read.keys() == held.keys()
    assert all(torch.equal(read[name], held[name]) for name in read)


def test_the_size_of_a_pixel_is_the_distance_between_the_points_that_two_show(
    run: ResolvedRun, cpu_renderer: Renderer[Any]
) -> None:
    shown = run.config.discriminator.model_copy(update={"gbuffer": True, "pixel_size": True})
    real = source_of(run.with_config(discriminator=shown), cpu_renderer).real
    assert real.gbuffer is not None
    assert real.pixel_size is not None
    for buffer, coverage, size in zip(real.gbuffer.float(), real.coverage, real.pixel_size, strict=True):
        steps = buffer[:, 1:, :3] - buffer[:, :-1, :3]
        whole = ((coverage[:, 1:] > 0.99) & (coverage[:, :-1] > 0.99)) & (buffer[:, 1:, 3:].norm(dim=-1) > 0.99)
        lengths = float(steps.norm(dim=-1)[whole].median()) / 2.0
        assert float(size) == pytest.approx(math.log(512.0 * lengths, 16.0), abs=0.1)


@pytest.mark.parametrize("windows", [True, False])
def test_fakes_of_windows_are_transparent_at_their_border(windows: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """As exemplars are; else what lies outside would be painted like the border."""
    made: list[torch.Tensor] = []
    monkeypatch.setattr(step, "make_pair", lambda source, indices, scenes, layers, errors: made.append(layers))
    source: Any = SimpleNamespace(windowed=windows, inputs=lambda _: Inputs(torch.zeros(2, 6, 8, 8)))
    source.labels = source.scenes = source.drawn_errors = lambda *_: None
    generator = SimpleNamespace(paint=lambda *_: torch.ones(2, 8, 8, 4), random_fields=0)
    state: Any = SimpleNamespace(generator=generator, refined=None)
    step._pair(make_fabric("cpu"), state, source, [0, 1], np.random.default_rng(0), 0)
    (layers,) = made
    assert int(layers[..., 3].sum()) == 2 * (36 if windows else 64)
    assert torch.equal(layers[..., :3], torch.ones(2, 8, 8, 3))


def test_evaluations_show_learned_windows_as_exemplars_are_seen(run: ResolvedRun, cpu_renderer: Renderer[Any]) -> None:
    """From the same cameras, with nothing at the border, whatever a generator paints there."""
    source = source_of(run, cpu_renderer)
    exemplars, index = source.exemplars, run.dataset.index
    truths = torch.stack([layer.values for layer in exemplars.layers if layer is not None])
    opaque = torch.where(bordered(torch.ones_like(truths))[..., 3:] > 0.0, truths, torch.ones(4))
    layers_of = by_subject(exemplars, {"generated": opaque})
    relighter = Relighter.make(Relight(), index)
    relit = relighter.relit(exemplars, index.sampler("train"), cpu_renderer, layers_of, SilentDisplay())
    assert relit.flips["generated"] == relit.flips["truth"]
    assert [scene.scene.camera for scene in relit.scenes] == [scene.camera for scene in exemplars.scenes]
    learned, true = pictures(source, 0, layers_of(0).values())
    assert torch.equal(learned, true)


def test_windows_and_whole_layers_are_not_mixed(config: DatasetConfig, training_data: Data) -> None:
    known = train_config(training_data(generator=LOCAL), "train.yaml")
    assert resolve_config(known, config)
    mixed = config.model_copy(update={"camera": config.camera.model_copy(update={"close_ups": None})})
    assert resolve_config(known, mixed)
    near = config.camera.close_ups
    assert near is not None
    halves = config.camera.model_copy(update={"close_ups": near.model_copy(update={"share": 0.5})})
    with pytest.raises(ConfigError, match="windows of 32 texels, and its other pictures whole layers"):
        resolve_config(known, config.model_copy(update={"camera": halves}))
    deep = train_config(training_data(generator=LOCAL | {"downsamplings": 4}), "train.yaml")
    with pytest.raises(ConfigError, match="a texture of 32 texels cannot be halved 4 times"):
        resolve_config(deep, config)
    wide = train_config(training_data(generator={"norm": "instance"}), "train.yaml")
    with pytest.raises(ConfigError, match=r"instance norms are taken over whole maps.*set generator\.norm: pixel"):
        resolve_config(wide, config)


@pytest.fixture
def model(config: DatasetConfig, training_data: Data, dataset_data: Data, tmp_path: Path) -> Path:
    """Of a run on whole maps."""
    data = dataset_data(texture=64, splits={"train": {"views": 1, "meshes": {"procedural": {"count": 1}}}})
    whole = config.model_copy(update={"camera": validate(DatasetConfig, data, "here").camera})
    generate(whole, tmp_path / "whole", base=tmp_path)
    chosen = training_data(dataset=str(tmp_path / "whole"), steps=1)
    train(train_config(chosen, "train.yaml"), tmp_path / "model")
    return tmp_path / "model"


def test_detail_is_learned_over_the_layers_of_a_model(
    run: ResolvedRun, model: Path, training_data: Data, tmp_path: Path
) -> None:
    chosen = train_config(
        training_data(dataset=run.config.dataset, refines=str(model), generator=LOCAL, steps=2), "train.yaml"
    )
    whole, detail = load_model(model), tmp_path / "detail"
    state = train(chosen, detail)
    assert state.generator.refined is not None
    before, after = whole.generator.state_dict(), load_model(detail).generator.refined.state_dict()
    assert all(torch.equal(after[name], weights) for name, weights in before.items())
    assert state.generator.last.convolve.weight.abs().sum() > 0.0, "it has learned something"
    again = train(chosen.model_copy(update={"steps": 3}), detail, resume=True)
    assert again.step == 3
    found = evaluate(detail, split="train", device="cpu", oracle=False)
    wholes = found.source.inputs(range(4)).wholes
    assert wholes is not None
    assert len(wholes.geometry) == 2, "one for each mesh"
    with pytest.raises(ConfigError, match=r"in windows, and not all close-ups of .*whole have them"):
        RunConfig.load(detail).scored_on(Dataset.open(tmp_path / "whole"))


def test_what_cannot_be_refined_is_told(
    run: ResolvedRun, config: DatasetConfig, model: Path, training_data: Data
) -> None:
    def refused(message: str, dataset: DatasetConfig = config, **changes: Any) -> None:
        chosen = {"refines": str(model), "generator": LOCAL} | changes
        with pytest.raises(ConfigError, match=message):
            resolve_config(train_config(training_data(**chosen), "train.yaml"), dataset)

    assert config.camera.close_ups is not None
    far = config.camera.model_copy(update={"close_ups": None})
    refused("make a data set with camera.close_ups.window", config.model_copy(update={"camera": far}))
    train_split = config.splits["train"]
    tested = {"train": train_split, "test": train_split.model_copy(update={"camera": far})}
    refused("in every split", config.model_copy(update={"splits": tested}))
    refused(
        "the model learned from maps of 64 texels; wanted .* whole maps of 32",
        config.model_copy(update={"texture": 32}),
    )
    refused(
        "with another `embedding`, or with other `maps`",
        config.model_copy(update={"maps": {"roughness": Fixed(fixed=0.5)}}),
    )
    refused("mesh maps or random fields: set them", generator=LOCAL | {"mesh_maps": True})
    refused("name one of them", init=str(model))
    refused("generator.refined: `refines` fills it in", refines=None, generator=LOCAL | {"refined": {}})
