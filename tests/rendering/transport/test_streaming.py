"""Training where memory holds few transports: those prefetched or read again are the same."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.data.index import DatasetIndex
from svbrdfgan.plugins.registry import load_renderer
from svbrdfgan.rendering.transport.cache import TransportStore
from svbrdfgan.scene.loader import SceneLoader
from svbrdfgan.training.cached_rendering import CachedRendering
from svbrdfgan.training.config import ScenesConfig
from svbrdfgan.training.perturb import Perturbation

BATCHES = ([0, 1, 2], [3, 1, 0], [2, 2, 4], [5, 0, 3])


def transports(exemplars: Exemplars, folder: Path, **changes: Any) -> CachedRendering:
    sampler = DatasetIndex.load(folder).sampler("train")
    perturbation = Perturbation(ScenesConfig(camera_noise_degrees=5.0), sampler, None)
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    return CachedRendering(exemplars, perturbation, load_renderer("numpy"), 4, 2, device, **changes)


def rng(step: int) -> np.random.Generator:
    return np.random.default_rng([7, step])


def pictures(stages: CachedRendering, step: int) -> torch.Tensor:
    stage = stages.scenes(BATCHES[step], rng(step))
    layers = torch.rand(3, 32, 32, 4, generator=torch.Generator().manual_seed(step))
    image, coverage = stage.render(layers.to(stages.device))
    return torch.cat([image, coverage.unsqueeze(-1), stage.gbuffer], dim=-1).cpu()


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory, tiny_dataset: Path, tiny_exemplars: Exemplars) -> CachedRendering:
    """All in memory, with a cache of their own."""
    folder = tmp_path_factory.mktemp("stored") / "dataset"
    shutil.copytree(tiny_dataset, folder, ignore=shutil.ignore_patterns("cache"))
    stages = transports(replace(tiny_exemplars, loader=SceneLoader(folder)), tiny_dataset)
    stages.build(range(6))
    return stages


def test_a_small_budget_changes_nothing(stored: CachedRendering, tiny_dataset: Path) -> None:
    small = transports(stored.exemplars, tiny_dataset, cache_bytes=1)
    small.build(range(6))
    assert len(small._transports.held) == 1
    assert small._surfaces._held == {}
    for step in range(4):
        assert torch.equal(pictures(small, step), pictures(stored, step))


def test_what_is_prefetched_is_there_in_time(stored: CachedRendering, tiny_dataset: Path, monkeypatch: Any) -> None:
    two_batches = 6 * max(t.nbytes for t in stored._transports.held.values())
    small = transports(stored.exemplars, tiny_dataset, cache_bytes=two_batches)
    small.build(range(6))
    assert len(small._transports.held) < len(stored._transports.held)
    monkeypatch.setattr(TransportStore, "_load", None)  # a synchronous read would fail
    small.prefetch(BATCHES[0], rng(0))
    for step in range(4):
        if step < 3:
            small.prefetch(BATCHES[step + 1], rng(step + 1))
        assert torch.equal(pictures(small, step), pictures(stored, step))
    assert small._transports._pending == {}


def test_prefetching_the_same_twice_reads_it_once(stored: CachedRendering, tiny_dataset: Path) -> None:
    small = transports(stored.exemplars, tiny_dataset, cache_bytes=1)
    small.build(range(6))
    small.prefetch(BATCHES[0], rng(0))
    first = dict(small._transports._pending)
    small.prefetch(BATCHES[0], rng(0))
    assert small._transports._pending == first


def test_prefetching_what_was_never_built_leaves_it_to_the_stage(stored: CachedRendering, tiny_dataset: Path) -> None:
    later = transports(stored.exemplars, tiny_dataset)
    later.prefetch(BATCHES[0], rng(0))
    assert later._transports._pending == {}
    assert torch.equal(pictures(later, 0), pictures(stored, 0))
