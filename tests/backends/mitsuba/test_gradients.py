"""Gradients against finite differences: of the same picture for base colour, of its expectation for others."""

import math

import pytest
import torch
from svbrdfgan_mitsuba import MitsubaRenderer, prepared_scene, render_pass
from svbrdfgan_mitsuba.integrator import PathIntegrator
from svbrdfgan_mitsuba.prepared_scene import FilmChunk
from torch import Tensor

from svbrdfgan.testing import scenes
from svbrdfgan.types import Environment, Material, Materials, View

BASE, LIGHT, ROUGH = frozenset({"base_color"}), frozenset({"environment"}), frozenset({"roughness"})
HEIGHT, WIDTH = 7, 11


@pytest.fixture
def view() -> View:
    return scenes.corner_view(scenes.random_light(5, 8, rotation=0.3), width=WIDTH, height=HEIGHT)


@pytest.fixture
def materials() -> Materials:
    return scenes.lambertian(scenes.random_texture(5, 9), scenes.GREEN, scenes.random_texture(2, 3))


@pytest.fixture
def grad_image() -> Tensor:
    return torch.randn((HEIGHT, WIDTH, 3), generator=torch.Generator().manual_seed(1))


def lit(view: View, radiance: Tensor) -> View:
    return View(view.camera, Environment(radiance, view.environment.rotation), view.width, view.height)


def inner(a: Tensor, b: Tensor) -> float:
    return float((a.double() * b.double()).sum())


def test_direct_light_s_gradient_is_the_transpose_of_the_picture(
    renderer: MitsubaRenderer, view: View, materials: Materials, grad_image: Tensor
) -> None:
    """The image is linear in the textures, and in the light: <grad_image, render(x)> == <render_vjp(grad_image), x>."""
    prepared = renderer.prepare(scenes.corner_box())
    image = renderer.render(prepared, materials, view, spp=8, seed=5).image
    gradients = renderer.render_vjp(prepared, materials, view, grad_image, wrt=BASE | LIGHT, spp=8, seed=5)
    assert gradients.environment is not None
    maps = zip(gradients.materials, materials.parts, strict=True)
    through_maps = sum(inner(gradient["base_color"], material.base_color) for gradient, material in maps)
    truth = inner(image, grad_image)
    assert through_maps == pytest.approx(truth, rel=1e-4, abs=1e-4)
    assert inner(gradients.environment, view.environment.radiance) == pytest.approx(truth, rel=1e-4, abs=1e-4)


@pytest.mark.parametrize(("kept", "traced_again"), [(0, 7), (3 * 8 * WIDTH, 4), (2**22, 0)])
def test_what_is_kept_is_not_traced_again(
    view: View,
    materials: Materials,
    grad_image: Tensor,
    monkeypatch: pytest.MonkeyPatch,
    kept: int,
    traced_again: int,
) -> None:
    """Seven film chunks of a row each."""
    renderer, traced = MitsubaRenderer("cpu"), list[FilmChunk]()
    trace = PathIntegrator.trace_direct

    def counted(integrator: PathIntegrator, chunk: FilmChunk) -> object:
        traced.append(chunk)
        return trace(integrator, chunk)

    monkeypatch.setitem(prepared_scene.VERTICES, "cpu", 8 * WIDTH)
    monkeypatch.setitem(render_pass.KEPT, "cpu", kept)
    monkeypatch.setattr(PathIntegrator, "trace_direct", counted)
    prepared = renderer.prepare(scenes.corner_box())
    _, pullback = renderer.render_pullback(prepared, materials, view, wrt=BASE, spp=8, seed=5)
    traced.clear()
    gradients = pullback(grad_image)
    assert len(traced) == traced_again
    wanted = renderer.render_vjp(prepared, materials, view, grad_image, wrt=BASE, spp=8, seed=5)
    for found, expected in zip(gradients.materials, wanted.materials, strict=True):
        torch.testing.assert_close(found["base_color"], expected["base_color"])


@pytest.mark.parametrize("max_bounces", [1, 3])
@pytest.mark.parametrize(("part", "index"), [(0, (2, 3, 1)), (0, (0, 0, 0)), (1, (2,)), (2, (1, 1, 0))])
def test_base_colour_s_gradient_is_that_of_the_very_picture(
    view: View, materials: Materials, grad_image: Tensor, part: int, index: tuple[int, ...], max_bounces: int
) -> None:
    renderer = MitsubaRenderer("cpu", max_bounces)
    prepared = renderer.prepare(scenes.corner_box())

    def loss(step: float) -> float:
        maps = [material.base_color.clone() for material in materials.parts]
        maps[part][index] += step
        image = renderer.render(prepared, scenes.lambertian(*maps), view, spp=8, seed=2).image
        return inner(image, grad_image)

    gradients = renderer.render_vjp(prepared, materials, view, grad_image, wrt=BASE, spp=8, seed=2)
    gradient = float(gradients.materials[part]["base_color"][index])
    assert gradient == pytest.approx((loss(0.05) - loss(-0.05)) / 0.1, rel=5e-3, abs=1e-4)
    assert gradient != 0.0


def test_black_walls_have_gradients_of_what_they_would_reflect(view: View, grad_image: Tensor) -> None:
    """Path replay would divide by the reflected light here, which is zero."""
    renderer = MitsubaRenderer("cpu", max_bounces=3)
    prepared = renderer.prepare(scenes.corner_box())
    black, white = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)

    def loss(step: float) -> float:
        colors = scenes.lambertian(white, (step, step, step), white)
        return inner(renderer.render(prepared, colors, view, spp=16, seed=3).image, grad_image)

    args = (prepared, scenes.lambertian(white, black, white), view, grad_image)
    gradient = renderer.render_vjp(*args, wrt=BASE, spp=16, seed=3).materials[1]["base_color"]
    direct = MitsubaRenderer("cpu").render_vjp(*args, wrt=BASE, spp=16, seed=3).materials[1]["base_color"]
    step = 1e-2
    truth = (4.0 * loss(step) - 3.0 * loss(0.0) - loss(2.0 * step)) / (2.0 * step)
    assert float(gradient.sum()) == pytest.approx(truth, rel=0.01, abs=1e-3)
    assert abs(float(gradient.sum() - direct.sum())) > 0.05 * abs(truth)


def agrees(samples: list[tuple[float, float]]) -> None:
    """Means over seeds of a gradient and of a finite difference differ by less than four standard errors."""
    gap = torch.tensor([gradient - difference for gradient, difference in samples], dtype=torch.float64)
    size = torch.tensor([difference for _, difference in samples], dtype=torch.float64).mean().abs()
    error = float(gap.std()) / math.sqrt(len(gap))
    assert abs(float(gap.mean())) < 4.0 * error + 2e-3 * float(size)
    assert error < 0.1 * float(size)


@pytest.mark.parametrize("max_bounces", [1, 3])
def test_light_s_gradient_is_that_of_finite_differences(view: View, materials: Materials, max_bounces: int) -> None:
    """Along a step that keeps the brightness of every pixel, so that the same directions are drawn."""
    renderer = MitsubaRenderer("cpu", max_bounces)
    prepared = renderer.prepare(scenes.corner_box())
    cotangent = torch.tensor([1.0, -0.2, 0.1]).expand(HEIGHT, WIDTH, 3)
    radiance = 0.5 + view.environment.radiance
    tilt = radiance.shape[1] // 2
    step = torch.zeros_like(radiance)
    step[:, :tilt, 0], step[:, :tilt, 1] = 0.1, -0.1
    step[:, tilt:, 0], step[:, tilt:, 2] = 0.05, -0.05

    def loss(sign: float) -> float:
        image = renderer.render(prepared, materials, lit(view, radiance + sign * step), spp=16, seed=4).image
        return inner(image, cotangent)

    gradients = renderer.render_vjp(prepared, materials, lit(view, radiance), cotangent, wrt=LIGHT, spp=16, seed=4)
    assert gradients.environment is not None
    assert gradients.environment.shape == radiance.shape
    assert inner(gradients.environment, step) == pytest.approx((loss(1.0) - loss(-1.0)) / 2.0, rel=2e-3)


def test_every_pixel_of_the_light_has_its_gradient(renderer: MitsubaRenderer) -> None:
    """A plane sees the half of the sky that it faces, the first and the last column alike, and nothing of the other."""
    prepared = renderer.prepare(scenes.plane(40.0))
    view = scenes.front_view(scenes.constant_light(1.0, 8, 16), width=8, height=8)
    args = (prepared, scenes.lambertian((1.0, 1.0, 1.0)), view, torch.ones(8, 8, 3) / 64.0)
    gradient = renderer.render_vjp(*args, wrt=LIGHT, spp=1024, seed=0).environment
    assert gradient is not None
    assert (gradient[:, 5:11] == 0.0).all()  # the middle lies at -Z, behind the plane
    assert (gradient[1:7, [0, 1, 2, 13, 14, 15]] > 0.0).all()
    assert torch.allclose(gradient.sum(dim=(0, 1)), torch.ones(3), rtol=0.01)
    assert torch.allclose(gradient[:, :5], gradient[:, 11:].flip(1), rtol=0.2, atol=2e-3)


@pytest.mark.parametrize("max_bounces", [1, pytest.param(2, marks=pytest.mark.full)])
def test_roughness_s_gradient_is_that_of_finite_differences(view: View, max_bounces: int) -> None:
    renderer = MitsubaRenderer("cpu", max_bounces)
    prepared = renderer.prepare(scenes.corner_box())
    rough = 0.35 + 0.3 * torch.rand((3, 2, 1), generator=torch.Generator().manual_seed(3))
    cotangent = torch.linspace(0.5, 1.5, HEIGHT * WIDTH * 3).view(HEIGHT, WIDTH, 3)

    def glossy(roughness: Tensor) -> Materials:
        base = torch.tensor([0.05, 0.1, 0.0])
        plain = Material.lambertian((0.4, 0.4, 0.4))
        return Materials((Material({"base_color": base, "roughness": roughness}), plain, plain))

    def sample(seed: int) -> tuple[float, float]:
        up, down = (
            inner(renderer.render(prepared, glossy(rough + s), view, spp=4096, seed=seed).image, cotangent)
            for s in (0.05, -0.05)
        )
        gradients = renderer.render_vjp(prepared, glossy(rough), view, cotangent, wrt=ROUGH, spp=4096, seed=seed)
        assert gradients.materials[1] == {}
        return float(gradients.materials[0]["roughness"].sum()), (up - down) / 0.1

    agrees([sample(seed) for seed in range(12)])


@pytest.mark.parametrize("max_bounces", [1, pytest.param(2, marks=pytest.mark.full)])
@pytest.mark.parametrize(
    ("name", "step", "spp"), [("roughness", 0.02, 2048), ("metallic", 0.05, 1024), ("normal", 0.02, 2048)]
)
def test_a_map_s_gradient_is_that_of_finite_differences(
    view: View, max_bounces: int, name: str, step: float, spp: int
) -> None:
    """Along a step of another size in every texel, beside other maps that are textures."""
    renderer = MitsubaRenderer("cpu", max_bounces)
    prepared = renderer.prepare(scenes.corner_box())
    cotangent = torch.linspace(0.5, 1.5, HEIGHT * WIDTH * 3).view(HEIGHT, WIDTH, 3)
    random = torch.Generator().manual_seed(3)
    tilts = 0.12 * torch.rand((3, 3, 2), generator=random) - 0.06  # too little for any that is seen to be bent
    maps = {
        "base_color": scenes.random_texture(2, 3),
        "roughness": 0.4 + 0.3 * torch.rand((3, 2, 1), generator=random),
        "metallic": 0.2 + 0.6 * torch.rand((2, 2, 1), generator=random),
        "normal": torch.cat([tilts, torch.full((3, 3, 1), 0.7)], dim=-1),
    }
    direction = torch.rand(maps[name].shape, generator=random)
    if name == "normal":  # towards where most light comes from, so that the effects of texels add up
        direction = direction * torch.tensor([1.0, -1.0, 1.0])
    plain = Material.lambertian((0.4, 0.4, 0.4))

    def materials(sign: float) -> Materials:
        return Materials((Material({**maps, name: maps[name] + sign * step * direction}), plain, plain))

    def sample(seed: int) -> tuple[float, float]:
        up, down = (
            inner(renderer.render(prepared, materials(sign), view, spp=spp, seed=seed).image, cotangent)
            for sign in (1.0, -1.0)
        )
        wrt = renderer.capabilities.differentiable
        gradients = renderer.render_vjp(prepared, materials(0.0), view, cotangent, wrt=wrt, spp=spp, seed=seed)
        assert gradients.materials[1].keys() == {"base_color"}
        return inner(gradients.materials[0][name], direction), (up - down) / (2.0 * step)

    agrees([sample(seed) for seed in range(12)])


def test_base_colour_s_gradient_under_gloss_is_that_of_the_very_picture(
    renderer: MitsubaRenderer, view: View, grad_image: Tensor
) -> None:
    prepared = renderer.prepare(scenes.corner_box())

    def glossy(step: float) -> Materials:
        base = torch.tensor([0.5 + step, 0.4, 0.3])
        material = Material({"base_color": base, "roughness": torch.tensor([0.3])})
        return Materials((material, material, material))

    up, down = (
        inner(renderer.render(prepared, glossy(step), view, spp=8, seed=6).image, grad_image) for step in (0.2, -0.2)
    )
    gradients = renderer.render_vjp(prepared, glossy(0.0), view, grad_image, wrt=BASE | ROUGH, spp=8, seed=6)
    total = sum(float(gradient["base_color"][0]) for gradient in gradients.materials)
    assert total == pytest.approx((up - down) / 0.4, rel=1e-3, abs=1e-4)


@pytest.mark.parametrize("roughness", [0.0, 0.04])
def test_below_the_least_roughness_there_is_no_gradient(
    renderer: MitsubaRenderer, view: View, grad_image: Tensor, roughness: float
) -> None:
    material = Material({"base_color": torch.ones(3), "roughness": torch.tensor([roughness])})
    prepared = renderer.prepare(scenes.corner_box())
    args = (prepared, Materials((material, material, material)), view, grad_image)
    gradients = renderer.render_vjp(*args, wrt=ROUGH, spp=8, seed=0)
    assert all((gradient["roughness"] == 0.0).all() for gradient in gradients.materials)


def test_texels_that_no_sample_touches_have_no_gradient(renderer: MitsubaRenderer) -> None:
    prepared, view = renderer.prepare(scenes.sphere()), scenes.front_view(scenes.random_light())
    args = (prepared, scenes.lambertian(scenes.random_texture(8, 16)), view, torch.ones(16, 16, 3))
    gradient = renderer.render_vjp(*args, wrt=BASE, spp=16, seed=0).materials[0]["base_color"]
    assert (gradient[:, 6:10] == 0).all()  # the far side
    assert (gradient[3:5, :3] > 0).all()  # the near side


def test_a_constant_s_gradient_does_not_stand_still(renderer: MitsubaRenderer) -> None:
    """It is a sum of many equal numbers, which a float32 sum would lose."""
    view = scenes.front_view(scenes.constant_light(), width=64, height=64, vertical_fov=0.2)
    args = (renderer.prepare(scenes.plane()), scenes.lambertian((1.0, 1.0, 1.0)), view, torch.ones(64, 64, 3))
    gradient = renderer.render_vjp(*args, wrt=BASE, spp=256, seed=0).materials[0]["base_color"]
    image = renderer.render(*args[:3], spp=256, seed=0).image
    assert torch.allclose(gradient.double(), image.double().sum(dim=(0, 1)), rtol=1e-6)


def test_gradients_have_the_shape_of_their_maps_and_no_others(
    renderer: MitsubaRenderer, view: View, materials: Materials
) -> None:
    prepared = renderer.prepare(scenes.corner_box())
    args = (prepared, materials, view, torch.ones(HEIGHT, WIDTH, 3))
    gradients = renderer.render_vjp(*args, wrt=BASE | ROUGH, spp=1, seed=0)
    assert [g["base_color"].shape for g in gradients.materials] == [m.base_color.shape for m in materials.parts]
    assert all("roughness" not in gradient for gradient in gradients.materials)
    assert gradients.environment is None
    nothing = renderer.render_vjp(*args, wrt=frozenset(), spp=1, seed=0)
    assert nothing.materials == ({}, {}, {})
    only = renderer.render_vjp(*args, wrt=LIGHT, spp=1, seed=0)
    assert only.materials == ({}, {}, {})


def test_a_gradient_needs_no_contiguous_float32(renderer: MitsubaRenderer, view: View, materials: Materials) -> None:
    prepared = renderer.prepare(scenes.corner_box())
    given = torch.rand(3, WIDTH, HEIGHT, dtype=torch.float64).permute(2, 1, 0)
    a, b = (
        renderer.render_vjp(prepared, materials, view, g, wrt=BASE, spp=2, seed=0)
        for g in (given, given.float().contiguous())
    )
    assert torch.allclose(a.materials[0]["base_color"], b.materials[0]["base_color"], rtol=1e-6)
