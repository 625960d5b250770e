"""Pictures with their light divided out: what is left is reflectance, whatever the light."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from svbrdfgan.plugins import load_renderer
from svbrdfgan.training.config import TrainConfig, train_config
from svbrdfgan.training.feed import Feed, make_feed
from svbrdfgan.training.reflectance import Illumination
from svbrdfgan.training.stages import TransportStage
from svbrdfgan.training.step import sides

Data = Callable[..., dict[str, Any]]
Make = Callable[..., Feed]
EVERY = range(6)


@pytest.fixture(scope="module")
def make(training_data: Data, tiny_dataset: Path) -> Make:
    def feed(**changes: Any) -> Feed:
        config = train_config(training_data(discriminator={"sees": "reflectance"}, **changes), "here")
        return make_feed(config, tiny_dataset, "train", load_renderer("numpy"), torch.device("cpu"))

    return feed


@pytest.fixture(scope="module")
def matched(make: Make) -> Feed:
    return make()


def staged(feed: Feed, seed: int = 0) -> TransportStage:
    stage = feed.stage(EVERY, np.random.default_rng(seed))
    assert isinstance(stage, TransportStage)
    return stage


def painted(feed: Feed, color: tuple[float, float, float]) -> Tensor:
    size = feed.buffers.shape[-2:]
    return torch.tensor([*color, 1.0]).expand(len(EVERY), *size, 4)


def truth(feed: Feed) -> Tensor:
    layers = [layer for layer in feed.exemplars.layers if layer is not None]
    return torch.stack([layers[index] for index in range(len(EVERY))])


@pytest.mark.parametrize("environment", ["same", "redrawn"])
def test_one_reflectance_is_seen_as_itself_under_any_light(environment: str, make: Make) -> None:
    feed, color = make(scenes={"environment": environment}), (0.7, 0.2, 0.45)
    stage = staged(feed)
    lit = stage.illumination
    shown = lit.reflectance(stage.render(painted(feed, color)))
    assert lit.clear.float().mean() > 0.1
    torch.testing.assert_close(shown[lit.clear], torch.tensor(color).expand_as(shown[lit.clear]), rtol=1e-3, atol=1e-3)
    assert (shown[~lit.clear] == 0).all()


@pytest.mark.parametrize("spp", [2, 8, 64])
@pytest.mark.parametrize("scenes", [{}, {"environment": "redrawn"}])
def test_a_fake_of_the_truth_shows_what_its_exemplar_does(scenes: dict[str, Any], spp: int, make: Make) -> None:
    """On average, whatever its light; and with as much noise, whatever its samples, though by itself it has none."""
    feed = make(scenes=scenes, spp=spp)
    stage = staged(feed)
    (real, clear, _), (fake, _, _) = sides(feed, EVERY, stage, truth(feed))
    shown = clear > 0
    clean = stage.illumination.reflectance(stage.render(truth(feed)))[shown]
    off, feigned = ((image.float()[shown] - clean).abs() for image in (real, fake))
    assert off.mean() > 0.02
    torch.testing.assert_close(off.mean(), feigned.mean(), rtol=0.15, atol=0.0)
    torch.testing.assert_close(real.float()[shown].mean(), clean.mean(), rtol=0.05, atol=0.0)


def test_light_is_taken_away(make: Make, matched: Feed) -> None:
    moved = make(scenes={"environment": "redrawn"})
    here, there = staged(matched), staged(moved)
    both = here.illumination.clear & there.illumination.clear
    radiance = [stage.render(truth(matched))[both] for stage in (here, there)]
    reflectance = [stage.illumination.reflectance(stage.render(truth(matched)))[both] for stage in (here, there)]
    apart = [(a - b).abs().mean() / a.mean() for a, b in (radiance, reflectance)]
    assert apart[1] < 0.25 * apart[0]


@pytest.mark.parametrize("scenes", [{}, {"camera_noise_degrees": 20.0}, {"environment": "redrawn"}])
def test_no_outline_tells_real_from_fake(scenes: dict[str, Any], make: Make) -> None:
    feed = make(scenes=scenes)
    (real, clear, _), (fake, other, _) = sides(feed, EVERY, staged(feed), truth(feed))
    assert torch.equal(clear, other)
    assert clear.mean() > 0.05
    assert all((image[clear == 0] == 0).all() for image in (real, fake))


def test_the_gradient_is_that_of_the_product_divided_by_the_light(matched: Feed) -> None:
    """By finite differences; the quotient is linear in the layer's colours."""
    stage, rng = staged(matched), torch.Generator().manual_seed(0)
    layers = truth(matched).clone()
    layers[..., 3] = 0.5
    layers.requires_grad_(True)
    weight = torch.rand(stage.coverage.shape, generator=rng).unsqueeze(-1)

    def total(of: Tensor) -> Tensor:
        return (sides(matched, EVERY, stage, of)[1][0] * weight).sum()

    total(layers).backward()
    assert layers.grad is not None
    direction = torch.rand(layers.shape, generator=rng) * torch.tensor([1.0, 1.0, 1.0, 0.0])
    with torch.no_grad():
        difference = (total(layers + 0.01 * direction) - total(layers - 0.01 * direction)) / 0.02
    torch.testing.assert_close((layers.grad * direction).sum(), difference, rtol=1e-2, atol=1e-3)
    assert layers.grad.abs().sum() > 0


def test_what_is_dark_or_hardly_learnable_is_not_clear() -> None:
    white, guide = torch.ones(1, 1, 4, 3), torch.zeros(1, 1, 4, 6)
    guide[..., 4] = torch.tensor([1.0, 1.0, 0.4, 0.0])
    white[0, 0, 1, 2] = 0.01
    lit = Illumination.of(white, torch.zeros_like(white), guide)
    assert lit.clear.flatten().tolist() == [True, False, False, False]
    assert lit.reflectance(torch.full_like(white, 9.0))[0, 0, :, 0].tolist() == [1.5, 0.0, 0.0, 0.0]


def test_exemplars_are_divided_by_light_of_no_fewer_samples(make: Make, matched: Feed) -> None:
    coarse = make(spp=1)
    assert coarse.demodulated is not None
    assert matched.demodulated is not None
    assert torch.equal(coarse.demodulated.reflectance, matched.demodulated.reflectance)
    assert torch.equal(coarse.demodulated.noise, matched.demodulated.noise)


def test_radiance_is_the_default(training_data: Data) -> None:
    assert TrainConfig.model_validate(training_data()).discriminator.sees == "radiance"
