"""The transport is the picture without materials, and its transpose is the gradient."""

import pytest
import torch
from svbrdfgan_warp import WarpRenderer
from svbrdfgan_warp.prepared_scene import PreparedSurface, film_chunks

from svbrdfgan.geometry.texels import bilinear_taps, sample_texture
from svbrdfgan.testing import scenes
from svbrdfgan.types import Camera, Materials, Surface, TransportSamples, View

SPP, SEED = 8, 3


@pytest.fixture
def view() -> View:
    return View(Camera((-1.5, 1.2, 2.0)), scenes.random_light(rotation=0.3), 11, 7)


@pytest.fixture
def materials() -> Materials:
    return scenes.lambertian(scenes.random_texture(5, 9), scenes.random_texture(4, 4, seed=1))


def shifted(surface: Surface, repeat: tuple[bool, bool]) -> Surface:
    """The surface with uv from -0.7 to 1.7."""
    uv = surface.uv * 2.4 - 0.7
    return scenes.surface_of(surface.positions, surface.normals, uv, surface.faces, surface.face_part, repeat)


def samples_of(renderer: WarpRenderer, prepared: PreparedSurface, view: View) -> TransportSamples:
    chunks = list(renderer.transport(prepared, view, spp=SPP, seed=SEED))
    return TransportSamples(
        *(torch.cat([getattr(c, name) for c in chunks]) for name in ("pixel", "part", "uv", "weight"))
    )


def albedo(samples: TransportSamples, materials: Materials, repeat: tuple[bool, bool]) -> torch.Tensor:
    colours = [sample_texture(m.base_color, samples.uv, repeat) for m in materials.parts]
    return torch.stack(colours)[samples.part, torch.arange(len(samples.part))]


@pytest.mark.parametrize("repeat", [(False, False), (True, False), (False, True)])
def test_transport_times_texture_is_the_picture(
    renderer: WarpRenderer, view: View, materials: Materials, repeat: tuple[bool, bool]
) -> None:
    prepared = renderer.prepare(shifted(scenes.occluder(), repeat))
    samples = samples_of(renderer, prepared, view)
    rendering = renderer.render(prepared, materials, view, spp=SPP, seed=SEED)
    image = torch.zeros(77, 3).index_add(0, samples.pixel, samples.weight * albedo(samples, materials, repeat))
    assert torch.allclose(image.view(7, 11, 3), rendering.image, rtol=1e-4, atol=1e-6)
    coverage = torch.bincount(samples.pixel, minlength=77) / SPP
    assert torch.equal(coverage.view(7, 11), rendering.coverage)
    assert rendering.image.mean() > 0.01


def test_the_transpose_of_transport_is_the_gradient(renderer: WarpRenderer, view: View, materials: Materials) -> None:
    prepared = renderer.prepare(scenes.occluder())
    samples = samples_of(renderer, prepared, view)
    grad_image = torch.randn((7, 11, 3), generator=torch.Generator().manual_seed(1))
    wrt = frozenset({"base_color"})
    gradients = renderer.render_vjp(prepared, materials, view, grad_image, wrt=wrt, spp=SPP, seed=SEED)
    for part, material in enumerate(materials.parts):
        rows, cols, _ = material.base_color.shape
        mine = samples.part == part
        index, taps = bilinear_taps(samples.uv[mine], rows, cols)
        given = samples.weight[mine] * grad_image.view(-1, 3)[samples.pixel[mine]]
        expected = torch.zeros(rows * cols, 3).index_add(
            0, index.flatten(), (taps[..., None] * given[:, None]).view(-1, 3)
        )
        gradient = gradients.materials[part]["base_color"]
        assert torch.allclose(gradient, expected.view(rows, cols, 3), rtol=1e-4, atol=1e-6)
        assert gradient.abs().max() > 0


def test_samples_in_the_dark_are_there_with_no_weight(renderer: WarpRenderer) -> None:
    view = scenes.front_view(scenes.constant_light(0.0))
    samples = samples_of(renderer, renderer.prepare(scenes.plane(2.0)), view)
    assert len(samples.pixel) > 0
    assert (samples.weight == 0).all()


def test_chunks_are_whole_pixels_that_tile_the_film(view: View) -> None:
    for spp in (1, 1000, 10**6):
        pieces = list(film_chunks(view, spp, 0, 2**15))
        assert [p.first for p in pieces] == [0, *torch.tensor([p.pixels for p in pieces]).cumsum(0).tolist()[:-1]]
        assert sum(p.pixels for p in pieces) == 77
        assert all(len(p) <= 2**15 or p.pixels == 1 for p in pieces)


def test_records_say_where_and_which_part(renderer: WarpRenderer) -> None:
    view = View(Camera((0.0, 0.0, 3.0), vertical_fov=0.6), scenes.constant_light(), 16, 8)
    samples = samples_of(renderer, renderer.prepare(scenes.two_parts()), view)
    col = samples.pixel % 16
    assert (samples.part[col < 8] == 0).all()
    assert (samples.part[col >= 8] == 1).all()
    assert (samples.pixel.diff() >= 0).all()
