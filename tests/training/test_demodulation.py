"""Pictures with their light divided out: what is left is reflectance, whatever the light."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from svbrdfgan.rendering.transport.product import TransportBatch
from svbrdfgan.training.batches import BatchSource, make_batch_source
from svbrdfgan.training.cached_rendering import CachedSceneBatch
from svbrdfgan.training.config import train_config
from svbrdfgan.training.demodulation import Demodulator, reproject
from svbrdfgan.training.resolve import resolve_run
from svbrdfgan.training.step import make_pair

Data = Callable[..., dict[str, Any]]
Make = Callable[..., BatchSource]
EVERY = range(6)


@pytest.fixture(scope="module")
def make(training_data: Data, cpu_renderer: Any, tiny_dataset: Path) -> Make:
    def make(**changes: Any) -> BatchSource:
        config = train_config(training_data(discriminator={"compares": "reflectance"}, **changes), "here")
        return make_batch_source(resolve_run(config), "train", cpu_renderer, torch.device("cpu"))

    return make


@pytest.fixture(scope="module")
def matched(make: Make) -> BatchSource:
    return make()


def scenes_of(source: BatchSource, seed: int = 0) -> CachedSceneBatch:
    scenes = source.scenes(EVERY, np.random.default_rng(seed))
    assert isinstance(scenes, CachedSceneBatch)
    return scenes


def own_light(source: BatchSource) -> Demodulator:
    demodulator = source.own_scenes.first_scenes(EVERY).demodulator
    assert demodulator is not None
    return demodulator


def painted(source: BatchSource, color: tuple[float, float, float]) -> Tensor:
    size = source.buffers.geometry.shape[-2:]
    return torch.tensor([*color, 1.0]).expand(len(EVERY), *size, 4)


def truth(source: BatchSource) -> Tensor:
    layers = [layer.values for layer in source.exemplars.layers if layer is not None]
    return torch.stack([layers[index] for index in range(len(EVERY))])


ELSEWHERE = {"camera": {"elevation_degrees": {"uniform": [40, 60]}}, "environment": "redrawn"}
SCENES: list[dict[str, Any]] = [{}, {"environment": "redrawn"}, {"camera_noise_degrees": 20.0}, ELSEWHERE]


@pytest.mark.parametrize("scenes", SCENES)
def test_one_reflectance_is_seen_as_itself_from_anywhere_under_any_light(scenes: dict[str, Any], make: Make) -> None:
    source, color = make(scenes=scenes), (0.7, 0.2, 0.45)
    batch = scenes_of(source)
    demodulator = batch.demodulator
    shown = demodulator.reflectance(batch.render(painted(source, color))[0])
    real, fake = make_pair(source, EVERY, batch, painted(source, color))
    for image, where in ((shown, demodulator.clear), (fake.image, real.coverage > 0)):
        assert where.float().mean() > 0.05
        torch.testing.assert_close(image[where], torch.tensor(color).expand_as(image[where]), rtol=1e-3, atol=1e-3)
        assert (image[~where] == 0).all()


@pytest.mark.parametrize("spp", [32, pytest.param(64, marks=pytest.mark.full)])
@pytest.mark.parametrize("scenes", SCENES)
def test_a_fake_of_the_truth_shows_what_its_exemplar_does(scenes: dict[str, Any], spp: int, make: Make) -> None:
    source = make(scenes=scenes, spp=spp)
    real, fake = make_pair(source, EVERY, scenes_of(source), truth(source))
    _, clean = make_pair(source, EVERY, scenes_of(source), torch.zeros_like(truth(source)))
    shown = real.coverage > 0
    apart, weathering = ((real.image - side.image)[shown].abs().mean() for side in (fake, clean))
    assert apart < 0.6 * weathering
    torch.testing.assert_close(real.image[shown].mean(), fake.image[shown].mean(), rtol=0.05, atol=0.0)


@pytest.mark.parametrize("scenes", SCENES)
def test_both_sides_are_blurred_alike(scenes: dict[str, Any], make: Make) -> None:
    """Exemplars without noise, and fakes of the truth; a fake that came one step fewer is sharper."""
    source = make(scenes=scenes)
    here, there = own_light(source), scenes_of(source).demodulator
    own = source.own_scenes.scenes(EVERY, np.random.default_rng(0))
    exact = replace(source, real=replace(source.real, image=own.render(truth(source))[0]))
    real, fake = make_pair(exact, EVERY, scenes_of(source), truth(source))
    sooner, _ = reproject(there.reflectance(scenes_of(source).render(truth(source))[0]), there.clear, there, here)
    sharp = [detail(image, real.coverage > 0) for image in (real.image, fake.image, sooner)]
    assert abs(sharp[0] / sharp[1] - 1) < 0.1
    assert sharp[2] > sharp[0]


def detail(image: Tensor, clear: Tensor) -> float:
    """Mean difference of neighbours."""
    pairs = clear[:, 1:] & clear[:, :-1]
    return float((image[:, 1:] - image[:, :-1])[pairs].abs().mean())


@pytest.mark.parametrize("scenes", SCENES)
def test_neither_outline_nor_gbuffer_tells_real_from_fake(scenes: dict[str, Any], make: Make) -> None:
    source = make(scenes=scenes)
    real, fake = make_pair(source, EVERY, scenes_of(source), truth(source))
    assert torch.equal(real.coverage, fake.coverage)
    assert real.gbuffer is not None
    assert fake.gbuffer is not None
    assert torch.equal(real.gbuffer, fake.gbuffer)
    assert real.coverage.mean() > 0.05
    assert all((side.image[side.coverage == 0] == 0).all() for side in (real, fake))


def test_only_what_both_views_see_is_shown(make: Make) -> None:
    source = make(scenes=ELSEWHERE)
    real, _ = make_pair(source, EVERY, scenes_of(source), truth(source))
    seen = own_light(source).clear
    assert not (real.coverage > 0)[~seen].any()
    assert real.coverage.sum() < 0.9 * seen.sum()


@pytest.mark.parametrize("scenes", [{}, ELSEWHERE])
def test_the_gradient_is_exact(scenes: dict[str, Any], make: Make) -> None:
    """By finite differences; what is seen is linear in the layer's colours."""
    source = make(scenes=scenes)
    batch, rng = scenes_of(source), torch.Generator().manual_seed(0)
    layers = truth(source).clone()
    layers[..., 3] = 0.5
    layers.requires_grad_(True)
    weight = torch.rand(batch.batch.coverage.shape, generator=rng).unsqueeze(-1)

    def total(of: Tensor) -> Tensor:
        return (make_pair(source, EVERY, batch, of)[1].image * weight).sum()

    total(layers).backward()
    assert layers.grad is not None
    direction = torch.rand(layers.shape, generator=rng) * torch.tensor([1.0, 1.0, 1.0, 0.0])
    with torch.no_grad():
        difference = (total(layers + 0.01 * direction) - total(layers - 0.01 * direction)) / 0.02
    torch.testing.assert_close((layers.grad * direction).sum(), difference, rtol=1e-2, atol=1e-3)
    assert layers.grad.abs().sum() > 0


def test_what_is_dark_or_hardly_learnable_is_not_clear(matched: BatchSource) -> None:
    batch = scenes_of(matched).batch
    first = batch.transports[0]
    gbuffer, background = torch.zeros_like(first.gbuffer), torch.zeros_like(first.background)
    gbuffer[..., 4] = torch.linspace(0, 1, len(gbuffer))[:, None]
    halved = TransportBatch.stack([replace(first, gbuffer=gbuffer, background=background)])
    sight, white = Demodulator.of(halved), halved.linear(torch.ones(len(first.parts), *first.texture_shape, 3))
    learnable = gbuffer[..., 4] >= 0.5
    bright = (white[0] > 0.02 * white[0][learnable].mean(dim=0)).all(dim=-1)
    assert 0 < sight.clear.sum() < (white[0] > 0).any(dim=-1).sum()
    assert torch.equal(sight.clear[0], learnable & bright)
    assert sight.reflectance(torch.full_like(white, 1e9)).unique().tolist() == [0.0, 1.5]


def test_exemplars_are_divided_by_light_of_no_fewer_samples(make: Make, matched: BatchSource) -> None:
    coarse = make(spp=1)
    for few, many in zip(own_light(coarse).shading, own_light(matched).shading, strict=True):
        assert torch.equal(few, many)
