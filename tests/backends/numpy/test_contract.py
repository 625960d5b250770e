"""Capabilities, and validation of options and arguments."""

import pytest
import torch
from svbrdfgan_numpy import NumpyRenderer

from svbrdfgan.errors import ConfigError
from svbrdfgan.protocols import Renderer
from svbrdfgan.testing import scenes

RENDERER = NumpyRenderer()
PREPARED = RENDERER.prepare(scenes.plane())
VIEW = scenes.front_view(scenes.constant_light())
WHITE = scenes.lambertian((1.0, 1.0, 1.0))
ONES = torch.ones(16, 16, 3)


def test_it_is_a_renderer_with_transport() -> None:
    assert isinstance(RENDERER, Renderer)
    assert RENDERER.device == torch.device("cpu")
    maps = {"base_color", "roughness", "metallic", "normal"}
    assert RENDERER.capabilities.maps == maps
    assert RENDERER.capabilities.differentiable == {*maps, "environment"}
    assert RENDERER.capabilities.alpha
    assert NumpyRenderer(max_bounces=5).capabilities.max_bounces == 5


@pytest.mark.parametrize("max_bounces", [0, -1, 65])
def test_impossible_bounces_are_refused(max_bounces: int) -> None:
    with pytest.raises(ConfigError, match="wanted 1 to 64"):
        NumpyRenderer(max_bounces=max_bounces)


def test_impossible_chunks_are_refused() -> None:
    with pytest.raises(ConfigError, match="chunk_vertices"):
        NumpyRenderer(chunk_vertices=0)
