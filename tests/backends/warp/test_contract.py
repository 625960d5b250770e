"""Options, validation, randomness, threads, and freedom from side effects."""

from collections.abc import Iterator

import pytest
import torch
import warp as wp
from svbrdfgan_warp import WarpRenderer
from svbrdfgan_warp.prepared_scene import PreparedSurface

from svbrdfgan.errors import ConfigError
from svbrdfgan.protocols import Renderer
from svbrdfgan.testing import scenes

WHITE = scenes.lambertian((1.0, 1.0, 1.0))
VIEW = scenes.front_view(scenes.random_light(), width=48, height=48)
ONES = torch.ones(48, 48, 3)


@pytest.fixture(scope="module")
def prepared(renderer: WarpRenderer) -> PreparedSurface:
    return renderer.prepare(scenes.sphere())


@pytest.fixture
def threads() -> Iterator[None]:
    before = torch.get_num_threads()
    yield
    torch.set_num_threads(before)


def test_it_is_a_renderer_with_transport(device: str) -> None:
    renderer = WarpRenderer(device)
    assert isinstance(renderer, Renderer)
    assert renderer.capabilities.transport
    assert renderer.device.type == device
    assert renderer == WarpRenderer(device)


def test_results_live_on_its_device(device: str) -> None:
    renderer, wrt = WarpRenderer(device), frozenset({"base_color", "environment"})
    prepared = renderer.prepare(scenes.plane())
    rendering = renderer.render(prepared, WHITE, VIEW, spp=1, seed=0)
    gradients = renderer.render_vjp(prepared, WHITE, VIEW, ONES, wrt=wrt, spp=1, seed=0)
    (samples,) = renderer.transport(prepared, VIEW, spp=1, seed=0)
    results = [rendering.image, rendering.coverage, gradients.environment, gradients.materials[0]["base_color"]]
    results += [samples.weight, samples.uv]
    assert all(result.device == renderer.device and result.dtype == torch.float32 for result in results)
    assert samples.pixel.device == samples.part.device == renderer.device


@pytest.mark.parametrize("name", ["gpu", "cuda:", "CPU", "", "cuda:-1"])
def test_unknown_devices_are_refused(name: str) -> None:
    with pytest.raises(ConfigError, match="wanted 'auto', 'cpu', 'cuda' or 'cuda:N'"):
        WarpRenderer(device=name)


def test_a_device_that_is_not_there_is_refused() -> None:
    with pytest.raises(ConfigError, match="CUDA devices; choose 'cpu' or 'auto'"):
        WarpRenderer(device="cuda:99")


def test_auto_prefers_cuda() -> None:
    assert WarpRenderer().device.type == ("cuda" if torch.cuda.is_available() else "cpu")


def test_it_reads_every_map(renderer: WarpRenderer, prepared: PreparedSurface) -> None:
    assert renderer.capabilities.maps == {"base_color", "roughness", "metallic", "normal"}
    assert renderer.capabilities.differentiable == renderer.capabilities.maps | {"environment"}


def test_the_number_of_threads_changes_nothing(threads: None) -> None:
    materials, wrt = scenes.lambertian(scenes.random_texture(9, 5)), frozenset({"base_color", "environment"})
    renderer, results = WarpRenderer("cpu"), []
    prepared = renderer.prepare(scenes.sphere())
    for count in (1, 3):
        torch.set_num_threads(count)
        image = renderer.render(prepared, materials, VIEW, spp=64, seed=1).image
        gradients = renderer.render_vjp(prepared, materials, VIEW, ONES, wrt=wrt, spp=64, seed=1)
        weight = torch.cat([s.weight for s in renderer.transport(prepared, VIEW, spp=64, seed=1)])
        results.append((image, gradients.materials[0]["base_color"], gradients.environment, weight))
    assert all(torch.equal(one, three) for one, three in zip(*results, strict=True))


def test_a_caller_s_settings_are_left_alone(device: str, capfd: pytest.CaptureFixture[str]) -> None:
    level, default = wp.config.log_level, torch.get_default_dtype()
    scenes.picture(WarpRenderer(device), scenes.plane(), WHITE, scenes.front_view(VIEW.environment))  # loads kernels
    capfd.readouterr()
    wp.config.log_level = wp.LOG_DEBUG
    torch.set_default_dtype(torch.float64)
    try:
        with wp.Tape() as tape:
            rendering = scenes.picture(WarpRenderer(device), scenes.plane(), WHITE, scenes.front_view(VIEW.environment))
        assert wp.config.log_level == wp.LOG_DEBUG
    finally:
        wp.config.log_level = level
        torch.set_default_dtype(default)
    assert rendering.image.dtype == rendering.coverage.dtype == torch.float32
    assert not tape.launches
    assert capfd.readouterr().out == ""
