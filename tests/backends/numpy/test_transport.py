"""The transport is the picture without materials, and its transpose is the gradient."""

import torch
from svbrdfgan_numpy import NumpyRenderer
from torch import Tensor

from svbrdfgan.testing import scenes

SPP, SEED = 5, 11


def _picture_of_samples(renderer: NumpyRenderer, textures: list[Tensor], light_seed: int) -> tuple[Tensor, Tensor]:
    """Image and coverage by summing samples, with torch's own texture lookup."""
    view = scenes.front_view(scenes.random_light(seed=light_seed), vertical_fov=0.9)
    image, coverage = torch.zeros(16 * 16, 3), torch.zeros(16 * 16)
    for samples in renderer.transport(renderer.prepare(scenes.two_parts()), view, spp=SPP, seed=SEED):
        for part, texture in enumerate(textures):
            of_part = samples.part == part
            grid = 2.0 * samples.uv[of_part][None, None] - 1.0
            lookup = torch.nn.functional.grid_sample(
                texture.permute(2, 0, 1)[None], grid, padding_mode="border", align_corners=False
            )
            pixel = samples.pixel[of_part]
            image = image.index_add(0, pixel, samples.weight[of_part] * lookup[0, :, 0].T)
            coverage = coverage.index_add(0, pixel, torch.full(pixel.shape, 1.0 / SPP))
    return image.reshape(16, 16, 3), coverage.reshape(16, 16)


def test_samples_make_the_picture_and_its_gradient() -> None:
    textures = [scenes.random_texture(4, 6).requires_grad_(), scenes.random_texture(7, 3, seed=1).requires_grad_()]
    renderer = NumpyRenderer(chunk_vertices=400)
    view = scenes.front_view(scenes.random_light(seed=2), vertical_fov=0.9)
    prepared, materials = renderer.prepare(scenes.two_parts()), scenes.lambertian(*textures)
    image, coverage = _picture_of_samples(renderer, textures, light_seed=2)
    truth = renderer.render(prepared, materials, view, spp=SPP, seed=SEED)
    assert torch.allclose(image, truth.image, atol=1e-5)
    assert torch.allclose(coverage, truth.coverage)

    cotangent = torch.randn(16, 16, 3, generator=torch.Generator().manual_seed(0))
    image.backward(cotangent)
    gradients = renderer.render_vjp(
        prepared, materials, view, cotangent, wrt=frozenset({"base_color"}), spp=SPP, seed=SEED
    )
    for texture, gradient in zip(textures, gradients.materials, strict=True):
        assert torch.allclose(texture.grad, gradient["base_color"], atol=1e-5)


def test_a_sample_in_the_dark_is_still_a_sample() -> None:
    renderer, view = NumpyRenderer(), scenes.front_view(scenes.constant_light(0.0), vertical_fov=0.2)
    samples = list(renderer.transport(renderer.prepare(scenes.plane()), view, spp=2, seed=0))
    assert sum(len(chunk.pixel) for chunk in samples) == 2 * 16 * 16
    assert all((chunk.weight == 0.0).all() for chunk in samples)
