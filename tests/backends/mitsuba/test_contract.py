"""Options, validation, randomness, film chunks, and freedom from side effects."""

import math
from typing import Any

import pytest
import torch
from svbrdfgan_mitsuba import MitsubaRenderer, prepared_scene, variant
from svbrdfgan_mitsuba.interop import dr, floats, tensor
from svbrdfgan_mitsuba.prepared_scene import PreparedSurface

from svbrdfgan.errors import ConfigError, PluginError
from svbrdfgan.plugins.registry import load_renderer
from svbrdfgan.protocols import Renderer
from svbrdfgan.testing import scenes
from svbrdfgan.types import CHANNELS

WHITE = scenes.lambertian((1.0, 1.0, 1.0))
VIEW = scenes.front_view(scenes.random_light(), width=24, height=16)
ONES = torch.ones(16, 24, 3)
BASE = frozenset({"base_color"})


@pytest.fixture(scope="module")
def prepared(renderer: MitsubaRenderer) -> PreparedSurface:
    return renderer.prepare(scenes.sphere())


def test_it_is_found_by_name_and_is_a_renderer_with_transport(renderer: MitsubaRenderer) -> None:
    assert isinstance(renderer, Renderer)
    assert renderer.device == torch.device("cpu")
    assert load_renderer("mitsuba", {"device": "cpu"}).plugin == renderer
    deep = load_renderer("mitsuba", {"device": "cpu", "max_bounces": 3})
    assert (deep.capabilities.max_bounces, deep.capabilities.transport) == (3, False)


@pytest.mark.parametrize("name", ["gpu", "cuda:", "CPU", "", "cuda:1"])
def test_unknown_devices_are_refused(name: str) -> None:
    with pytest.raises(ConfigError, match="wanted 'auto', 'cpu', 'cuda' or 'cuda:0'"):
        MitsubaRenderer(device=name)


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a CUDA device")
def test_a_device_that_is_not_there_is_refused() -> None:
    with pytest.raises(ConfigError, match="finds no CUDA device; choose 'cpu'"):
        MitsubaRenderer(device="cuda")


def test_a_gpu_that_torch_alone_can_use_is_passed_over_unless_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    has_backend = dr.has_backend

    def without_cuda(backend: Any) -> bool:
        return backend != dr.JitBackend.CUDA and bool(has_backend(backend))

    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(variant.dr, "has_backend", without_cuda)
    assert variant.choose_device("auto") == torch.device("cpu")
    with pytest.raises(PluginError, match="drjit cannot use CUDA here"):
        variant.choose_device("cuda")


@pytest.mark.parametrize("bounces", [0, -1, 65])
def test_impossible_bounces_are_refused(bounces: int) -> None:
    with pytest.raises(ConfigError, match=f"max_bounces is {bounces}; wanted 1 to 64"):
        MitsubaRenderer("cpu", max_bounces=bounces)


def test_it_reads_and_differentiates_the_whole_material(renderer: MitsubaRenderer) -> None:
    assert renderer.capabilities.maps == set(CHANNELS)
    assert renderer.capabilities.differentiable == {*CHANNELS, "environment"}


@pytest.mark.parametrize(("rows", "cols"), [(1, 1), (1, 5), (3, 1), (2, 2)])
def test_the_smallest_environments_light_evenly(
    renderer: MitsubaRenderer, prepared: PreparedSurface, rows: int, cols: int
) -> None:
    view = scenes.front_view(scenes.constant_light(2.0, rows, cols))
    seen = scenes.surface_radiance(renderer.render(prepared, WHITE, view, spp=256, seed=0))
    assert torch.allclose(seen, torch.full((3,), 2.0), rtol=0.02)


def test_the_seed_alone_decides(renderer: MitsubaRenderer, prepared: PreparedSurface) -> None:
    seeds = (7, 7, 8, 7 + 2**32, -1)
    first, again, *others = (renderer.render(prepared, WHITE, VIEW, spp=4, seed=seed).image for seed in seeds)
    assert torch.equal(first, again)
    assert not any(torch.equal(first, other) for other in others)


def test_seeds_and_pixels_are_independent(renderer: MitsubaRenderer) -> None:
    view = scenes.front_view(scenes.random_light(), vertical_fov=0.2, width=32, height=32)
    plane = renderer.prepare(scenes.plane())
    seeds = torch.stack([renderer.render(plane, WHITE, view, spp=4, seed=s).image[..., 0].flatten() for s in range(4)])
    between = torch.corrcoef(seeds) - torch.eye(4)
    image = seeds[0].view(32, 32)
    beside = torch.corrcoef(torch.stack([image[:, :-1].flatten(), image[:, 1:].flatten()]))[0, 1]
    assert float(between.abs().max()) < 4.0 / math.sqrt(1024)
    assert abs(float(beside)) < 4.0 / math.sqrt(992)


def test_the_error_falls_as_the_root_of_the_samples(renderer: MitsubaRenderer) -> None:
    view = scenes.front_view(scenes.random_light(), vertical_fov=0.2, width=32, height=32)
    plane = renderer.prepare(scenes.plane())
    few, many = (renderer.render(plane, WHITE, view, spp=spp, seed=spp).image.std(dim=(0, 1)) for spp in (4, 64))
    assert torch.allclose(few / many, torch.full((3,), 4.0), rtol=0.15)  # 1024 pixels: standard deviation 3 %


def test_the_size_of_a_chunk_changes_nothing(renderer: MitsubaRenderer, monkeypatch: pytest.MonkeyPatch) -> None:
    prepared = renderer.prepare(scenes.corner_box())
    materials = scenes.lambertian(scenes.random_texture(3, 5), scenes.RED, scenes.GREEN)
    view, wrt = scenes.corner_view(scenes.random_light()), BASE | {"environment"}
    results = []
    for size in (2**20, 77):
        monkeypatch.setitem(prepared_scene.VERTICES, "cpu", size)
        rendering = renderer.render(prepared, materials, view, spp=5, seed=1)
        grad = renderer.render_vjp(prepared, materials, view, torch.ones(12, 12, 3), wrt=wrt, spp=5, seed=1)
        results.append((rendering, grad))
    (whole, whole_grad), (cut, cut_grad) = results
    assert torch.equal(whole.image, cut.image)
    assert torch.equal(whole.coverage, cut.coverage)
    assert torch.allclose(whole_grad.environment, cut_grad.environment, rtol=1e-5)
    a, b = (g.materials[0]["base_color"] for g in (whole_grad, cut_grad))
    assert torch.allclose(a, b, rtol=1e-5)


def test_arrays_are_shared_without_copies() -> None:
    import mitsuba.llvm_ad_rgb as mi

    values = torch.rand(1001)[1:]
    there = floats(mi, values, torch.device("cpu"))
    assert tensor(there).data_ptr() == values.data_ptr()
    made = there * 2.0
    assert tensor(made).data_ptr() == tensor(made).data_ptr()


def test_a_caller_s_settings_are_left_alone(
    renderer: MitsubaRenderer, prepared: PreparedSurface, capfd: pytest.CaptureFixture[str]
) -> None:
    import mitsuba.llvm_ad_rgb as mi

    flags = {flag: dr.flag(flag) for flag in dr.JitFlag if flag != dr.JitFlag.Default}
    state, default = torch.get_rng_state(), torch.get_default_dtype()
    x = mi.Float(3.0)
    dr.enable_grad(x)
    pending = x * x
    torch.set_default_dtype(torch.float64)
    try:
        with dr.suspend_grad():
            gradients = renderer.render_vjp(prepared, WHITE, VIEW, ONES, wrt=BASE, spp=2, seed=0)
        rendering = renderer.render(prepared, WHITE, VIEW, spp=2, seed=0)
    finally:
        torch.set_default_dtype(default)
    assert float(gradients.materials[0]["base_color"].sum()) > 1.0
    assert rendering.image.dtype == rendering.coverage.dtype == gradients.materials[0]["base_color"].dtype
    assert rendering.image.dtype == torch.float32
    dr.backward(pending)
    assert dr.grad(x)[0] == 6.0
    assert torch.equal(state, torch.get_rng_state())
    assert flags == {flag: dr.flag(flag) for flag in flags}
    assert capfd.readouterr() == ("", "")


def test_inputs_that_want_gradients_are_only_read(renderer: MitsubaRenderer, prepared: PreparedSurface) -> None:
    texture = torch.rand(4, 4, 3, requires_grad=True)
    before = texture.detach().clone()
    image = renderer.render(prepared, scenes.lambertian(texture), VIEW, spp=1, seed=0).image
    assert not image.requires_grad
    assert texture.grad is None
    assert torch.equal(texture, before)
