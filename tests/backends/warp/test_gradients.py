"""The gradient is the exact derivative of the picture with the same seed."""

import pytest
import torch
from svbrdfgan_warp import WarpRenderer

from svbrdfgan.testing import scenes
from svbrdfgan.types import Materials, View

BASE = frozenset({"base_color"})


@pytest.fixture
def view() -> View:
    return scenes.front_view(scenes.random_light(rotation=0.3), width=11, height=7)


@pytest.fixture
def materials() -> Materials:
    return scenes.lambertian(scenes.random_texture(5, 9), scenes.GREEN)


@pytest.fixture
def grad_image() -> torch.Tensor:
    return torch.randn((7, 11, 3), generator=torch.Generator().manual_seed(1))


def test_the_gradient_is_the_transpose_of_the_picture(
    renderer: WarpRenderer, view: View, materials: Materials, grad_image: torch.Tensor
) -> None:
    """The image is linear in the textures: <grad_image, render(m)> == <render_vjp(grad_image), m>."""
    prepared = renderer.prepare(scenes.two_parts())
    image = renderer.render(prepared, materials, view, spp=8, seed=5).image
    gradients = renderer.render_vjp(prepared, materials, view, grad_image, wrt=BASE, spp=8, seed=5)
    through = sum(
        (gradient["base_color"].double() * material.base_color.double()).sum()
        for gradient, material in zip(gradients.materials, materials.parts, strict=True)
    )
    assert float(through) == pytest.approx(float((image.double() * grad_image.double()).sum()), rel=1e-5, abs=1e-5)


@pytest.mark.parametrize(("part", "index"), [(0, (2, 3, 1)), (0, (0, 0, 0)), (1, (2,))])
def test_the_gradient_is_that_of_finite_differences(
    renderer: WarpRenderer,
    view: View,
    materials: Materials,
    grad_image: torch.Tensor,
    part: int,
    index: tuple[int, ...],
) -> None:
    prepared = renderer.prepare(scenes.two_parts())

    def loss(step: float) -> float:
        maps = [material.base_color.clone() for material in materials.parts]
        maps[part][index] += step
        image = renderer.render(prepared, scenes.lambertian(*maps), view, spp=4, seed=2).image
        return float((image.double() * grad_image.double()).sum())

    gradients = renderer.render_vjp(prepared, materials, view, grad_image, wrt=BASE, spp=4, seed=2)
    gradient = float(gradients.materials[part]["base_color"][index])
    assert gradient == pytest.approx((loss(0.5) - loss(-0.5)), rel=1e-3, abs=1e-5)
    assert gradient != 0.0


def test_texels_that_no_sample_touches_have_no_gradient(renderer: WarpRenderer) -> None:
    prepared = renderer.prepare(scenes.sphere())
    view = scenes.front_view(scenes.random_light())
    texture = scenes.random_texture(8, 16)
    args = (prepared, scenes.lambertian(texture), view, torch.ones(16, 16, 3))
    gradient = renderer.render_vjp(*args, wrt=BASE, spp=16, seed=0).materials[0]["base_color"]
    assert (gradient[:, 6:10] == 0).all()  # the far side
    assert (gradient[3:5, :3] > 0).all()  # the near side


def test_gradients_have_the_shape_of_their_maps(renderer: WarpRenderer, view: View, materials: Materials) -> None:
    prepared = renderer.prepare(scenes.two_parts())
    gradients = renderer.render_vjp(prepared, materials, view, torch.ones(7, 11, 3), wrt=BASE, spp=1, seed=0)
    assert [g["base_color"].shape for g in gradients.materials] == [m.base_color.shape for m in materials.parts]
    nothing = renderer.render_vjp(prepared, materials, view, torch.ones(7, 11, 3), wrt=frozenset(), spp=1, seed=0)
    assert nothing.materials == ({}, {})
    assert nothing.environment is None


def test_a_gradient_needs_no_contiguous_float32(renderer: WarpRenderer, view: View, materials: Materials) -> None:
    prepared = renderer.prepare(scenes.two_parts())
    given = torch.rand(3, 11, 7, dtype=torch.float64).permute(2, 1, 0)
    plain = given.float().contiguous()
    a, b = (renderer.render_vjp(prepared, materials, view, g, wrt=BASE, spp=2, seed=0) for g in (given, plain))
    assert torch.allclose(a.materials[0]["base_color"], b.materials[0]["base_color"], rtol=1e-6)


def test_sums_of_very_many_samples_stay_exact(renderer: WarpRenderer) -> None:
    """A constant colour and a constant light each sum a million terms or more in one number."""
    prepared, colour = renderer.prepare(scenes.plane(2.0)), torch.tensor([0.5, 0.25, 1.0])
    view = scenes.front_view(scenes.constant_light((3.0, 2.0, 1.0), 1, 1), distance=1.0)
    args = (prepared, scenes.lambertian(colour), view)
    image = renderer.render(*args, spp=1024, seed=0).image.double().sum(dim=(0, 1))
    both = BASE | {"environment"}
    gradients = renderer.render_vjp(*args, torch.ones(16, 16, 3), wrt=both, spp=1024, seed=0)
    assert gradients.environment is not None
    assert torch.allclose(gradients.materials[0]["base_color"].double() * colour, image, rtol=1e-5)
    assert torch.allclose(gradients.environment.double() * view.environment.radiance, image, rtol=1e-5)
