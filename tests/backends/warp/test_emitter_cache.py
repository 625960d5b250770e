"""The emitter cache finds environments that were rendered before, and only by their contents."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch
from svbrdfgan_warp import WarpRenderer, environment
from torch import Tensor

from svbrdfgan.testing import scenes
from svbrdfgan.types import Environment

Render = Callable[[Tensor], Tensor]


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[Tensor]:
    """The images for which tables were made."""
    calls: list[Tensor] = []
    make = environment._tables
    monkeypatch.setattr(environment, "_tables", lambda radiance: (calls.append(radiance), make(radiance))[1])
    return calls


@pytest.fixture
def render() -> Render:
    renderer = WarpRenderer("cpu")
    prepared, white = renderer.prepare(scenes.sphere()), scenes.lambertian((1.0, 1.0, 1.0))

    def picture(radiance: Tensor) -> Tensor:
        view = scenes.front_view(Environment(radiance), width=4, height=4)
        return renderer.render(prepared, white, view, spp=1, seed=0).image

    return picture


def lights(count: int) -> list[Tensor]:
    return [scenes.random_light(seed=seed).radiance for seed in range(count)]


def test_a_dozen_in_turn_are_made_once(render: Render, made: list[Tensor]) -> None:
    for _ in range(2):
        for radiance in lights(12):  # equal tensors, not the same ones
            render(radiance)
    assert len(made) == 12


def test_one_that_was_written_into_is_new(render: Render, made: list[Tensor]) -> None:
    """Even where torch does not see the write."""
    radiance = lights(1)[0]
    before = render(radiance)
    radiance.numpy()[...] *= 2.0
    assert torch.allclose(render(radiance), 2.0 * before)
    assert len(made) == 2


def test_of_large_ones_fewer_are_kept(render: Render, made: list[Tensor], monkeypatch: pytest.MonkeyPatch) -> None:
    one, two, three = lights(3)
    monkeypatch.setattr(environment, "_PIXELS", 2 * one.numel() // 3)
    for radiance in (one, two, three, two, one):
        render(radiance)
    assert len(made) == 4
    monkeypatch.setattr(environment, "_PIXELS", 1)  # the last environment is always kept
    for _ in range(2):
        render(three)
    assert len(made) == 5
