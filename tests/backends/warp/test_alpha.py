"""Rays pass through parts by their alpha; opaque surfaces keep the kernels that know nothing of it."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import torch
from numpy import ndarray
from svbrdfgan_warp import WarpRenderer
from svbrdfgan_warp.render_pass import RenderPass

from svbrdfgan.geometry.texels import sample_texture
from svbrdfgan.testing import scenes
from svbrdfgan.types import Camera, Material, Materials, Surface, TransportSamples, View

MAPS = frozenset({"base_color", "roughness", "environment"})
TEXTURE = np.array([[0.9, 0.2, 0.5], [0.0, 1.0, 0.4]])


def with_alpha(surface: Surface, *alpha: float | ndarray) -> Surface:
    parts = tuple(dataclasses.replace(part, alpha=a) for part, a in zip(surface.parts, alpha, strict=True))
    return dataclasses.replace(surface, parts=parts)


def screened(alpha: float | ndarray, behind: float = 1.0) -> Surface:
    """A white plane (part 0) and in front of it, towards +Z, a screen without end (part 1)."""
    screen = scenes.quad((-40.0, -40.0, 0.5), (80.0, 0.0, 0.0), (0.0, 80.0, 0.0))
    return with_alpha(scenes.joined(scenes.plane(2.0), screen), behind, alpha)


def close_view(size: int = 8) -> View:
    return scenes.front_view(scenes.constant_light(), width=size, height=size, vertical_fov=0.3)


@pytest.mark.parametrize(("behind", "alpha"), [(1.0, 0.25), (1.0, 0.0), (0.5, 0.3), (0.0, 1.0)])
def test_a_screen_weakens_light_on_both_ways(renderer: WarpRenderer, behind: float, alpha: float) -> None:
    """The plane is seen through a black screen with 1 - alpha, and lit through it with as much again."""
    prepared = renderer.prepare(screened(alpha, behind))
    seen = renderer.render(
        prepared, scenes.lambertian((1.0, 1.0, 1.0), (0.0, 0.0, 0.0)), close_view(), spp=1024, seed=0
    )
    passed = 1.0 - alpha
    assert float(seen.image.mean()) == pytest.approx(behind * passed * passed, rel=0.02, abs=1e-6)
    assert float(seen.coverage.mean()) == pytest.approx(1.0 - passed * (1.0 - behind), rel=0.01, abs=1e-6)


@pytest.mark.parametrize("repeat", [(False, False), (True, False), (False, True)])
def test_alpha_lies_as_textures_do(renderer: WarpRenderer, repeat: tuple[bool, bool]) -> None:
    """Coverage of a single plane is its alpha as a texture is looked up."""
    plane = scenes.plane(2.0)
    sheet = with_alpha(dataclasses.replace(plane, uv=plane.uv * 2.4 - 0.7, repeat=repeat), TEXTURE)
    view = scenes.front_view(scenes.constant_light(), 2.0, width=16, height=16, vertical_fov=2.0 * math.atan(0.5))
    coverage = renderer.render(renderer.prepare(sheet), scenes.lambertian((1.0, 1.0, 1.0)), view, spp=4096, seed=0)
    fine = (torch.arange(16 * 16) + 0.5) / 256.0
    v, u = torch.meshgrid(1.0 - fine, fine, indexing="ij")
    uv = torch.stack([u, v], dim=-1).view(-1, 2) * 2.4 - 0.7
    wanted = sample_texture(torch.from_numpy(TEXTURE).float()[..., None], uv, repeat)
    wanted = wanted.view(16, 16, 16, 16).mean(dim=(1, 3))
    assert torch.allclose(coverage.coverage, wanted, atol=5.0 * 0.5 / 64.0)
    assert float((coverage.coverage - wanted).abs().mean()) < 0.008


def test_faces_are_passed_independently(renderer: WarpRenderer) -> None:
    """Eight sheets of alpha 0.2 one behind the other, in any order of their faces, let 0.8 ^ 8 pass."""
    sheets = [scenes.quad((-9.0, -9.0, -0.1 * i), (18.0, 0.0, 0.0), (0.0, 18.0, 0.0)) for i in range(8)]
    surface = with_alpha(scenes.joined(*sheets), *[0.2] * 8)
    black = scenes.lambertian(*[(0.0, 0.0, 0.0)] * 8)
    counts = []
    for each in (surface, scenes.shuffled(surface)):
        seen = renderer.render(renderer.prepare(each), black, close_view(16), spp=1024, seed=0)
        counts.append(1.0 - float(seen.coverage.mean()))
    error = math.sqrt(0.8**8 / (16 * 16 * 1024))
    assert all(abs(count - 0.8**8) < 5 * error for count in counts)


@pytest.fixture
def view() -> View:
    return View(Camera((0.5, 0.4, 3.0), vertical_fov=0.5), scenes.random_light(rotation=0.3), 11, 7)


def test_transport_and_gradients_are_those_of_the_picture(renderer: WarpRenderer, view: View) -> None:
    surface, spp = screened(TEXTURE, 0.7), 16
    materials = scenes.lambertian(scenes.random_texture(5, 9), scenes.random_texture(4, 4, seed=1))
    prepared, args = renderer.prepare(surface), {"spp": spp, "seed": 3}
    chunks = list(renderer.transport(prepared, view, **args))
    samples = TransportSamples(
        *(torch.cat([getattr(c, name) for c in chunks]) for name in ("pixel", "part", "uv", "weight"))
    )
    rendering = renderer.render(prepared, materials, view, **args)
    colours = torch.stack([sample_texture(m.base_color, samples.uv) for m in materials.parts])
    albedo = colours[samples.part, torch.arange(len(samples.part))]
    image = torch.zeros(77, 3).index_add(0, samples.pixel, samples.weight * albedo).view(7, 11, 3)
    assert torch.allclose(image, rendering.image, rtol=1e-4, atol=1e-6)
    assert torch.equal(torch.bincount(samples.pixel, minlength=77).view(7, 11) / spp, rendering.coverage)
    grad_image = torch.randn((7, 11, 3), generator=torch.Generator().manual_seed(1))
    gradients = renderer.render_vjp(prepared, materials, view, grad_image, wrt=MAPS, **args)
    loss = float((image.double() * grad_image).sum())
    maps = zip(gradients.materials, materials.parts, strict=True)
    through = sum(float((g["base_color"].double() * m.base_color).sum()) for g, m in maps)
    assert gradients.environment is not None
    assert through == pytest.approx(loss, rel=1e-4)
    assert float((gradients.environment.double() * view.environment.radiance).sum()) == pytest.approx(loss, rel=1e-4)


def test_alpha_of_one_changes_nothing(device: str, view: View) -> None:
    """The kernels of alpha, with nothing to pass, give the picture of those that opaque parts use."""
    renderer, opaque = WarpRenderer(device), screened(1.0, 1.0)
    gloss = Material({"base_color": torch.tensor(scenes.RED), "roughness": torch.tensor([0.3])})
    materials = Materials((gloss, Material.lambertian(scenes.GREEN)))
    parts = (*opaque.parts, dataclasses.replace(opaque.parts[0], name="unused", alpha=0.5))
    clear = dataclasses.replace(opaque, parts=parts)
    plain = renderer.prepare(opaque)
    assert plain.alpha is None
    lambertian = scenes.lambertian(scenes.RED, scenes.GREEN)
    assert isinstance(renderer._render_pass(plain, lambertian, view, MAPS, 1, 0), RenderPass)
    one = renderer.render(plain, materials, view, spp=32, seed=4)
    other = renderer.render(renderer.prepare(clear), Materials((*materials.parts, gloss)), view, spp=32, seed=4)
    assert torch.allclose(one.image, other.image, rtol=1e-5, atol=1e-6)
    assert torch.equal(one.coverage, other.coverage)
