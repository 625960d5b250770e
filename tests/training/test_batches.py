"""Batches of a split: which scenes are traced, and what the discriminator is shown of them."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from svbrdfgan.plugins import load_renderer
from svbrdfgan.training.batches import BatchSource, _by_subject, load_seen_texels, make_batch_source
from svbrdfgan.training.cached_rendering import CachedRendering
from svbrdfgan.training.config import TrainConfig, train_config
from svbrdfgan.training.resolve import resolve_run

CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def config(training_data: Callable[..., dict[str, Any]]) -> Callable[..., TrainConfig]:
    return lambda **changes: train_config(training_data(**changes), "here")


@pytest.fixture(scope="module")
def source(config: Callable[..., TrainConfig], tiny_dataset: Path) -> BatchSource:
    return make_batch_source(resolve_run(config()), "train", load_renderer("numpy"), CPU)


def test_a_held_out_split_is_never_perturbed(config: Callable[..., TrainConfig], tiny_dataset: Path) -> None:
    perturbed = config(scenes={"camera_noise_degrees": 20.0, "pool": 2})
    source = make_batch_source(resolve_run(perturbed), "validation", load_renderer("numpy"), CPU)
    _, coverage = source.scenes([0, 1], np.random.default_rng(0)).render(torch.zeros(2, 32, 32, 4))
    assert (coverage - source.real.coverage.float()).abs().mean() < 0.03


def test_guides_are_of_the_exemplars_own_scenes(
    config: Callable[..., TrainConfig], source: BatchSource, tiny_dataset: Path
) -> None:
    """However fakes are perturbed, the discriminator sees real pictures beside their own geometry."""
    perturbed = config(scenes={"camera_noise_degrees": 20.0})
    moved = make_batch_source(resolve_run(perturbed), "train", load_renderer("numpy"), CPU)
    assert source.real.gbuffer is not None
    assert moved.real.gbuffer is not None
    assert (
        moved.real.gbuffer - source.real.gbuffer
    ).float().abs().mean() < 0.05 * source.real.gbuffer.float().abs().mean()
    assert replace(source.real, gbuffer=None).pick([0]).gbuffer is None
    assert all(torch.equal(moved.seen(index), source.seen(index)) for index in range(len(source)))
    assert moved.own_scenes is not moved.fake_scenes


@pytest.fixture
def traced(monkeypatch: pytest.MonkeyPatch, source: BatchSource, dataset_copy: Path) -> list[int]:
    """The exemplars whose scenes would have been traced, their own or others; none is stored."""
    shutil.rmtree(dataset_copy / "cache" / "transports", ignore_errors=True)
    found: list[int] = []
    stored = source.own_scenes.batch([0]).transports[0]  # type: ignore[union-attr]
    monkeypatch.setattr(CachedRendering, "_trace", lambda self, index, scene: found.append(index) or stored)
    return found


@pytest.mark.parametrize(
    ("discriminator", "own"),
    [
        ({"guide": False, "sees": "radiance"}, 0),
        ({"guide": True, "sees": "radiance"}, 6),
        ({"guide": False, "sees": "reflectance"}, 6),
    ],
)
def test_own_scenes_are_traced_where_something_looks_at_them(
    discriminator: dict[str, Any],
    own: int,
    config: Callable[..., TrainConfig],
    dataset_copy: Path,
    traced: list[int],
) -> None:
    chosen = config(
        dataset=str(dataset_copy), discriminator=discriminator, scenes={"camera_noise_degrees": 20.0}, spp=1
    )
    source = make_batch_source(resolve_run(chosen), "train", load_renderer("numpy"), CPU)
    assert sorted(traced) == sorted([*range(6), *range(own)])
    held = source.own_scenes._cache  # type: ignore[union-attr]
    assert len(held) == (6 if discriminator["sees"] == "reflectance" else min(own, 1))
    assert source.seen(0).max() > 0
    assert len(traced) == 6 + max(own, 1)


def test_what_is_held_out_is_traced_once_and_when_asked_for(
    config: Callable[..., TrainConfig], dataset_copy: Path, traced: list[int]
) -> None:
    chosen = config(
        dataset=str(dataset_copy), discriminator={"sees": "reflectance"}, scenes={"camera_noise_degrees": 20.0}, spp=1
    )
    exemplars, seen = load_seen_texels(resolve_run(chosen), "validation", load_renderer("numpy"))
    assert traced == []
    assert all(seen(index).max() > 0 for index in range(len(exemplars)))
    assert traced == [0, 1]
    assert seen(0).max() > 0
    assert traced == [0, 1]


def test_a_fresh_stage_renders_each_layer_once(
    config: Callable[..., TrainConfig], tiny_dataset: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    renderer, rendered = load_renderer("numpy"), []
    source = make_batch_source(resolve_run(config(rendering="fresh")), "train", renderer, CPU)
    render = type(renderer).render
    monkeypatch.setattr(
        type(renderer), "render", lambda self, *args, **how: rendered.append(1) or render(self, *args, **how)
    )
    image, coverage = source.scenes([0, 4], np.random.default_rng(0)).render(torch.zeros(2, 32, 32, 4))
    assert len(rendered) == 2
    assert (image.shape, coverage.shape) == ((2, 32, 32, 3), (2, 32, 32))
    assert coverage.max() == 1


def test_processes_begin_with_scenes_of_different_subjects(source: BatchSource) -> None:
    """In any order, but with all views of a subject in a row, which is prepared once."""
    orders = {tuple(_by_subject(source.exemplars)) for _ in range(64)}
    assert orders == {(0, 1, 2, 3, 4, 5), (3, 4, 5, 0, 1, 2)}


@pytest.mark.parametrize("pool", [1, 2])
def test_scenes_that_are_not_perturbed_serve_as_the_exemplars_own(
    pool: int, config: Callable[..., TrainConfig], tiny_dataset: Path
) -> None:
    matched = make_batch_source(resolve_run(config(scenes={"pool": pool})), "train", load_renderer("numpy"), CPU)
    assert matched.own_scenes is matched.fake_scenes
