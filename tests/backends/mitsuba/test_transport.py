"""The transport is the picture without materials, and its transpose is the gradient."""

import pytest
import torch
from svbrdfgan_mitsuba import MitsubaRenderer, prepared_scene
from svbrdfgan_mitsuba.prepared_scene import PreparedSurface

from svbrdfgan.geometry.texels import sample_texture
from svbrdfgan.testing import scenes
from svbrdfgan.types import Camera, Materials, Surface, TransportSamples, View

SPP, SEED = 8, 3
VIEW = View(Camera((-1.5, 1.2, 2.0)), scenes.random_light(rotation=0.3), 11, 7)
MATERIALS = scenes.lambertian(scenes.random_texture(5, 9), scenes.random_texture(4, 4, seed=1))


@pytest.fixture(params=[2**20, 100], ids=["in one chunk", "in many chunks"])
def chunk_size(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(prepared_scene.VERTICES, "cpu", request.param)


def shifted(surface: Surface, repeat: tuple[bool, bool]) -> Surface:
    """The surface with uv from -0.7 to 1.7."""
    uv = surface.uv * 2.4 - 0.7
    return scenes.surface_of(surface.positions, surface.normals, uv, surface.faces, surface.face_part, repeat)


def samples_of(renderer: MitsubaRenderer, prepared: PreparedSurface) -> TransportSamples:
    chunks = list(renderer.transport(prepared, VIEW, spp=SPP, seed=SEED))
    return TransportSamples(
        *(torch.cat([getattr(c, name) for c in chunks]) for name in ("pixel", "part", "uv", "weight"))
    )


def albedo(samples: TransportSamples, materials: Materials, repeat: tuple[bool, bool]) -> torch.Tensor:
    colours = [sample_texture(m.base_color, samples.uv, repeat) for m in materials.parts]
    return torch.stack(colours)[samples.part, torch.arange(len(samples.part))]


@pytest.mark.usefixtures("chunk_size")
@pytest.mark.parametrize("repeat", [(False, False), (True, False), (False, True)])
def test_transport_times_texture_is_the_picture(renderer: MitsubaRenderer, repeat: tuple[bool, bool]) -> None:
    prepared = renderer.prepare(shifted(scenes.occluder(), repeat))
    samples = samples_of(renderer, prepared)
    rendering = renderer.render(prepared, MATERIALS, VIEW, spp=SPP, seed=SEED)
    image = torch.zeros(77, 3).index_add(0, samples.pixel, samples.weight * albedo(samples, MATERIALS, repeat))
    assert torch.allclose(image.view(7, 11, 3), rendering.image, rtol=1e-4, atol=1e-6)
    coverage = torch.bincount(samples.pixel, minlength=77) / SPP
    assert torch.equal(coverage.view(7, 11), rendering.coverage)
    assert rendering.image.mean() > 0.01
    assert (samples.pixel.diff() >= 0).all()


def test_the_transpose_of_transport_is_the_gradient(renderer: MitsubaRenderer) -> None:
    prepared = renderer.prepare(scenes.occluder())
    samples = samples_of(renderer, prepared)
    grad_image = torch.randn((7, 11, 3), generator=torch.Generator().manual_seed(1))
    args = (prepared, MATERIALS, VIEW, grad_image)
    gradients = renderer.render_vjp(*args, wrt=frozenset({"base_color"}), spp=SPP, seed=SEED)
    for part, material in enumerate(MATERIALS.parts):
        mine = samples.part == part
        texture = material.base_color.clone().requires_grad_()
        value = sample_texture(texture, samples.uv[mine], (False, False)) * samples.weight[mine]
        (value * grad_image.view(-1, 3)[samples.pixel[mine]]).sum().backward()
        assert torch.allclose(gradients.materials[part]["base_color"], texture.grad, rtol=1e-4, atol=1e-5)


def test_shadowed_samples_are_recorded_with_no_weight(renderer: MitsubaRenderer) -> None:
    camera = Camera((0.5, 0.25, 2.0), (0.5, 0.0, 0.0), vertical_fov=0.05)
    view = View(camera, scenes.sun(1, 0, rows=180, cols=4), 4, 4)
    (samples,) = renderer.transport(renderer.prepare(scenes.occluder()), view, spp=4, seed=0)
    assert len(samples.pixel) == 64
    assert (samples.weight.sum(dim=0) < 0.05).all()
    assert samples.pixel.dtype == samples.part.dtype == torch.int64
