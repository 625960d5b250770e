"""Batches of a split: which scenes are traced, and what the discriminator is shown of them."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from svbrdfgan.errors import ConfigError
from svbrdfgan.plugins.registry import load_renderer
from svbrdfgan.training import batches
from svbrdfgan.training.batches import BatchSource, _by_subject, load_seen_texels, make_batch_source
from svbrdfgan.training.cached_rendering import CachedRendering
from svbrdfgan.training.config import ScenesConfig, TrainConfig, train_config
from svbrdfgan.training.online_rendering import OnlineRendering, OnlineSceneBatch
from svbrdfgan.training.reference_pictures import ReferencePictures
from svbrdfgan.training.resolve import _require_divisible, resolve_run
from svbrdfgan.training.step import make_pair
from svbrdfgan.utils import large_tensors

CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def config(training_data: Callable[..., dict[str, Any]]) -> Callable[..., TrainConfig]:
    return lambda **changes: train_config(training_data(**changes), "here")


@pytest.fixture(scope="module")
def source(config: Callable[..., TrainConfig], cpu_renderer: Any, tiny_dataset: Path) -> BatchSource:
    return make_batch_source(resolve_run(config()), "train", cpu_renderer, CPU)


def test_a_held_out_split_is_never_perturbed(
    config: Callable[..., TrainConfig], cpu_renderer: Any, tiny_dataset: Path
) -> None:
    perturbed = config(scenes={"camera_noise_degrees": 20.0, "pool": 2})
    source = make_batch_source(resolve_run(perturbed), "validation", cpu_renderer, CPU)
    _, coverage = source.scenes([0, 1], np.random.default_rng(0)).render(torch.zeros(2, 32, 32, 4))
    assert (coverage - source.real.coverage.float()).abs().mean() < 0.03


def test_gbuffers_are_of_the_exemplars_own_scenes(
    config: Callable[..., TrainConfig], cpu_renderer: Any, source: BatchSource, tiny_dataset: Path
) -> None:
    """However fakes are perturbed, the discriminator sees real pictures beside their own geometry."""
    perturbed = config(scenes={"camera_noise_degrees": 20.0})
    moved = make_batch_source(resolve_run(perturbed), "train", cpu_renderer, CPU)
    assert source.real.gbuffer is not None
    assert moved.real.gbuffer is not None
    assert (
        moved.real.gbuffer - source.real.gbuffer
    ).float().abs().mean() < 0.05 * source.real.gbuffer.float().abs().mean()
    assert replace(source.real, gbuffer=None).pick([0]).gbuffer is None
    assert all(torch.equal(moved.seen(index), source.seen(index)) for index in range(len(source)))
    assert moved.own_scenes is not moved.fake_scenes


def test_pictures_in_files_are_those_in_memory(
    config: Callable[..., TrainConfig], cpu_renderer: Any, source: BatchSource, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(large_tensors, "_SHARE", 0.0)
    monkeypatch.setattr(batches, "_ON_DEVICE", 0.0)
    streamed = make_batch_source(resolve_run(config()), "train", cpu_renderer, CPU)
    one, other = (vars(each.pictures([4, 1])) for each in (source, streamed))
    assert {name for name, values in one.items() if values is not None} >= {"image", "coverage", "gbuffer"}
    for name, values in one.items():
        assert values is None or torch.equal(values, other[name])


@pytest.fixture
def traced(monkeypatch: pytest.MonkeyPatch, source: BatchSource, dataset_copy: Path) -> list[int]:
    """The exemplars whose scenes would have been traced, their own or others; none is stored."""
    shutil.rmtree(dataset_copy / "cache" / "transports", ignore_errors=True)
    found: list[int] = []
    stored = source.own_scenes._stored((0, 0))  # type: ignore[attr-defined]
    monkeypatch.setattr(CachedRendering, "_trace", lambda self, index, scene: found.append(index) or stored)
    return found


@pytest.mark.parametrize(
    ("discriminator", "own"),
    [
        ({"gbuffer": False, "compares": "radiance"}, 0),
        ({"gbuffer": True, "compares": "radiance"}, 6),
        ({"gbuffer": False, "compares": "reflectance"}, 6),
    ],
)
def test_own_scenes_are_traced_where_something_looks_at_them(
    discriminator: dict[str, Any],
    own: int,
    config: Callable[..., TrainConfig],
    cpu_renderer: Any,
    dataset_copy: Path,
    traced: list[int],
) -> None:
    chosen = config(
        dataset=str(dataset_copy), discriminator=discriminator, scenes={"camera_noise_degrees": 20.0}, spp=1
    )
    source = make_batch_source(resolve_run(chosen), "train", cpu_renderer, CPU)
    assert sorted(traced) == sorted([*range(6), *range(own)])
    held = source.own_scenes._transports.held  # type: ignore[attr-defined]
    assert len(held) == (6 if discriminator["compares"] == "reflectance" else min(own, 1))
    assert source.seen(0).max() > 0
    assert len(traced) == 6 + max(own, 1)


def test_what_is_held_out_is_traced_once_and_when_asked_for(
    config: Callable[..., TrainConfig], cpu_renderer: Any, dataset_copy: Path, traced: list[int]
) -> None:
    chosen = config(
        dataset=str(dataset_copy),
        discriminator={"compares": "reflectance"},
        scenes={"camera_noise_degrees": 20.0},
        spp=1,
    )
    exemplars, seen = load_seen_texels(resolve_run(chosen), "validation", cpu_renderer)
    assert traced == []
    assert all(seen(index).max() > 0 for index in range(len(exemplars)))
    assert traced == [0, 1]
    assert seen(0).max() > 0
    assert traced == [0, 1]


def test_a_fresh_stage_renders_each_layer_once(
    config: Callable[..., TrainConfig], cpu_renderer: Any, tiny_dataset: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    renderer, rendered = cpu_renderer, []
    source = make_batch_source(resolve_run(config(rendering="online")), "train", renderer, CPU)
    render = type(renderer).render
    monkeypatch.setattr(
        type(renderer), "render", lambda self, *args, **how: rendered.append(1) or render(self, *args, **how)
    )
    image, coverage = source.scenes([0, 4], np.random.default_rng(0)).render(torch.zeros(2, 32, 32, 4))
    assert len(rendered) == 2
    assert (image.shape, coverage.shape) == ((2, 32, 32, 3), (2, 32, 32))
    assert coverage.max() == 1


LIT: dict[str, Any] = {
    "rendering": "online",
    "discriminator": {"gbuffer": True, "light_buffer": True, "clean_picture": True},
}


@pytest.fixture(scope="module")
def lit(config: Callable[..., TrainConfig], cpu_renderer: Any, tiny_dataset: Path) -> BatchSource:
    """Matched scenes, in which the discriminator is shown all buffers."""
    return make_batch_source(resolve_run(config(**LIT, spp=4)), "train", cpu_renderer, CPU)


def perturbed(source: BatchSource, **scenes: Any) -> BatchSource:
    """The same exemplars, and fakes in perturbed scenes."""
    assert isinstance(source.fake_scenes, OnlineRendering)
    perturbation = replace(source.fake_scenes.perturbation, config=ScenesConfig(**scenes))
    return replace(source, fake_scenes=replace(source.fake_scenes, perturbation=perturbation))


def test_matched_fakes_share_their_exemplars_buffers(lit: BatchSource) -> None:
    source = lit
    scenes = source.scenes([1, 3], np.random.default_rng(0))
    assert scenes.gbuffer is None
    assert scenes.light_buffer is None
    real, fake = make_pair(source, [1, 3], scenes, torch.zeros(2, 32, 32, 4))
    assert real.light_buffer is not None
    assert real.light_buffer.shape == (2, 32, 32, 9)
    assert fake.light_buffer is real.light_buffer
    assert fake.gbuffer is real.gbuffer
    assert real.clean is not None
    assert fake.clean is real.clean
    assert source.real.light_buffer is not None
    assert source.real.light_buffer.dtype == torch.float16


def test_a_fake_in_other_light_carries_its_own_scenes_light(lit: BatchSource) -> None:
    """It is what an exemplar of that scene would carry, sample for sample; position and normal stay the exemplar's."""
    source = perturbed(lit, environment="redrawn")
    scenes = source.scenes([2], np.random.default_rng(1))
    real, fake = make_pair(source, [2], scenes, torch.zeros(1, 32, 32, 4))
    assert fake.gbuffer is real.gbuffer
    assert real.light_buffer is not None
    assert fake.light_buffer is not None
    assert not fake.light_buffer.requires_grad
    apart = (fake.light_buffer - real.light_buffer).float().abs().mean()
    assert apart > 0.1 * real.light_buffer.float().mean()
    assert fake.clean is not None
    assert real.clean is not None
    assert not torch.equal(fake.clean, real.clean)
    assert isinstance(scenes, OnlineSceneBatch)
    there = replace(source.exemplars, scenes=(*source.exemplars.scenes[:2], *scenes.scenes))
    assert isinstance(source.own_scenes, OnlineRendering)
    real_there = replace(source.own_scenes, exemplars=there).first_scenes([2])
    assert real_there.light_buffer is not None
    assert torch.equal(real_there.light_buffer, fake.light_buffer)


def test_a_fake_in_another_camera_carries_both_its_own_buffers(lit: BatchSource) -> None:
    source = perturbed(lit, camera_noise_degrees=20.0)
    scenes = source.scenes([2], np.random.default_rng(1))
    real, fake = make_pair(source, [2], scenes, torch.zeros(1, 32, 32, 4))
    for mine, its in ((real.gbuffer, fake.gbuffer), (real.light_buffer, fake.light_buffer)):
        assert mine is not None
        assert its is not None
        assert (mine - its).abs().mean() > 0.1 * mine.abs().mean()
    shown = fake.gbuffer[..., 3:].norm(dim=-1)[0] if fake.gbuffer is not None else torch.zeros(32, 32)
    assert (shown > 0.5).sum() > 20
    assert fake.coverage[0][shown > 0.5].mean() > 0.95  # beside this camera's picture, not the exemplar's


def test_pictures_of_gloss_are_not_divided_by_their_light(config: Callable[..., TrainConfig]) -> None:
    """Whatever the rendering, in one sentence."""
    gloss = SimpleNamespace(maps={"roughness": 0.5, "metallic": 0.0})
    with pytest.raises(ConfigError, match=r"reflectance is for base_color alone.* roughness, metallic too"):
        _require_divisible(config(discriminator={"compares": "reflectance"}), gloss)  # type: ignore[arg-type]
    _require_divisible(config(discriminator={"compares": "radiance"}), gloss)  # type: ignore[arg-type]
    _require_divisible(config(discriminator={"compares": "reflectance"}), SimpleNamespace(maps={}))  # type: ignore[arg-type]


def test_no_buffer_is_rendered_that_is_not_shown(
    config: Callable[..., TrainConfig], cpu_renderer: Any, tiny_dataset: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("gbuffer", "light_buffer"):
        monkeypatch.setattr(ReferencePictures, name, lambda self: pytest.fail("nobody looks at it"))
    plain = config(rendering="online", scenes={"camera_noise_degrees": 20.0})
    source = make_batch_source(resolve_run(plain), "train", cpu_renderer, CPU)
    real, fake = make_pair(source, [0], source.scenes([0], np.random.default_rng(0)), torch.zeros(1, 32, 32, 4))
    assert (real.gbuffer, real.light_buffer, fake.gbuffer, fake.light_buffer) == (None,) * 4


def test_a_renderer_without_metal_cannot_show_light(
    config: Callable[..., TrainConfig], tiny_dataset: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    renderer = load_renderer("numpy")
    plain = replace(renderer.capabilities, maps=frozenset({"base_color", "roughness"}))
    monkeypatch.setattr(type(renderer), "capabilities", plain)
    with pytest.raises(ConfigError, match="cannot render metallic"):
        make_batch_source(resolve_run(config(**LIT)), "train", renderer, CPU)


def test_processes_begin_with_scenes_of_different_subjects(source: BatchSource) -> None:
    """In any order, but with all views of a subject in a row, which is prepared once."""
    orders = {tuple(_by_subject(source.exemplars)) for _ in range(64)}
    assert orders == {(0, 1, 2, 3, 4, 5), (3, 4, 5, 0, 1, 2)}


@pytest.mark.parametrize("pool", [1, 2])
def test_scenes_that_are_not_perturbed_serve_as_the_exemplars_own(
    pool: int, config: Callable[..., TrainConfig], cpu_renderer: Any, tiny_dataset: Path
) -> None:
    matched = make_batch_source(resolve_run(config(scenes={"pool": pool})), "train", cpu_renderer, CPU)
    assert matched.own_scenes is matched.fake_scenes
