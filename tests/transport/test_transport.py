"""Light transport: the algebra, the merging and the file. Renderers are compared with it in their own tests."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from svbrdfgan.errors import AssetError
from svbrdfgan.texture_filter import sample_texture
from svbrdfgan.transport import LightTransport, TransportBatch, build_transport
from svbrdfgan.transport import build as build_module
from svbrdfgan.types import Camera, Environment, Material, Materials, TransportSamples, View

ROWS, COLS, SPP = 8, 6, 4
PAINT, GLASS, DECAL = Material.lambertian((0.5, 0.4, 0.3)), Material.lambertian((0.1, 0.1, 0.2)), None


def a_view(width: int = 5, height: int = 3) -> View:
    return View(Camera((0.0, 0.0, 3.0)), Environment(torch.ones(2, 4, 3)), width, height)


def random_samples(count: int, parts: int, seed: int = 0, pixels: int = 15) -> TransportSamples:
    rng = torch.Generator().manual_seed(seed)
    return TransportSamples(
        pixel=torch.randint(pixels, (count,), generator=rng),
        part=torch.randint(parts, (count,), generator=rng),
        uv=torch.rand(count, 2, generator=rng),
        weight=torch.rand(count, 3, generator=rng),
    )


def three_parts() -> Materials:
    decal = Material.lambertian(torch.rand(4, 4, 3, generator=torch.Generator().manual_seed(9)))
    return Materials((PAINT, GLASS, decal))


def built(chunks: list[TransportSamples], learnable: tuple[int, ...] = (0, 2), **changes: object) -> LightTransport:
    return build_transport(
        chunks, materials=three_parts(), learnable=learnable, guide=torch.rand(ROWS, COLS, 6), view=a_view(), spp=SPP
    )


def splatted(samples: TransportSamples, colors: list[torch.Tensor]) -> torch.Tensor:
    """The definition of `TransportSamples`, written out."""
    image = torch.zeros(15, 3)
    for n in range(len(samples.pixel)):
        color = colors[int(samples.part[n])]
        value = color if color.ndim == 1 else sample_texture(color, samples.uv[n : n + 1])[0]
        image[samples.pixel[n]] += samples.weight[n] * value
    return image.reshape(3, 5, 3)


def test_picture_is_background_plus_product() -> None:
    samples, materials = random_samples(300, 3), three_parts()
    textures = torch.rand(2, ROWS, COLS, 3)
    picture = TransportBatch.stack([built([samples])]).render(textures)[0]
    expected = splatted(samples, [textures[0], materials[1].base_color, textures[1]])
    torch.testing.assert_close(picture, expected, rtol=1e-5, atol=1e-5)


def test_nothing_learnable_is_all_background() -> None:
    samples = random_samples(100, 3)
    transport = built([samples], learnable=())
    assert transport.texels == 0
    expected = splatted(samples, [m.base_color for m in three_parts().parts])
    torch.testing.assert_close(transport.background, expected, rtol=1e-5, atol=1e-5)


def test_chunks_and_their_order_do_not_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = random_samples(200, 3, seed=1), random_samples(50, 3, seed=2)
    whole = built([first, second])
    monkeypatch.setattr(build_module, "_MERGE_AT", 100)
    merged_early = built([second, first])
    assert torch.equal(whole.texel, merged_early.texel)
    assert torch.equal(whole.start, merged_early.start)
    torch.testing.assert_close(whole.weight, merged_early.weight)


def test_entries_are_merged_and_sorted() -> None:
    transport = built([random_samples(500, 3)])
    for pixel in range(15):
        texels = transport.texel[transport.start[pixel] : transport.start[pixel + 1]]
        assert (texels.diff() > 0).all()


def test_coverage_counts_samples() -> None:
    pixel = torch.tensor([0, 0, 0, 7])
    samples = TransportSamples(pixel, torch.zeros(4).long(), torch.rand(4, 2), torch.zeros(4, 3))
    coverage = built([samples]).coverage.flatten()
    assert coverage[0] == 0.75
    assert coverage[7] == 0.25
    assert coverage.sum() == 1.0


def test_no_samples_at_all_is_a_black_picture() -> None:
    empty = TransportSamples(torch.zeros(0).long(), torch.zeros(0).long(), torch.zeros(0, 2), torch.zeros(0, 3))
    picture = TransportBatch.stack([built([empty])]).render(torch.ones(2, ROWS, COLS, 3))
    assert (picture == 0).all()


@pytest.mark.parametrize("views", [1, 3])
def test_transpose_is_the_adjoint(views: int) -> None:
    batch = TransportBatch.stack([built([random_samples(200, 3, seed=n)]) for n in range(views)])
    textures = torch.rand(2 * views, ROWS, COLS, 3, dtype=torch.float32)
    cotangent = torch.rand_like(batch.background)
    product = batch.multiply(textures.reshape(-1, 3))
    transposed = batch.multiply_transposed(cotangent.reshape(-1, 3), textures[..., 0].numel())
    forward = (product.double() * cotangent.reshape(-1, 3)).sum()
    backward = (textures.reshape(-1, 3).double() * transposed).sum()
    torch.testing.assert_close(forward, backward, rtol=1e-5, atol=1e-5)


def test_gradient_is_the_transpose() -> None:
    batch = TransportBatch.stack([built([random_samples(200, 3)])])
    textures = torch.rand(2, ROWS, COLS, 3, requires_grad=True)
    cotangent = torch.rand_like(batch.background)
    batch.render(textures).backward(cotangent)
    expected = batch.multiply_transposed(cotangent.reshape(-1, 3), 2 * ROWS * COLS)
    assert textures.grad is not None
    torch.testing.assert_close(textures.grad.reshape(-1, 3), expected)


def test_views_of_a_batch_do_not_touch_each_other() -> None:
    transports = [built([random_samples(100, 3, seed=n)]) for n in range(3)]
    textures = torch.rand(6, ROWS, COLS, 3)
    together = TransportBatch.stack(transports).render(textures)
    for n, transport in enumerate(transports):
        alone = TransportBatch.stack([transport]).render(textures[2 * n : 2 * n + 2])[0]
        torch.testing.assert_close(together[n], alone)


@pytest.mark.parametrize("brightness", [1e-6, 1.0, 1e7])
def test_half_precision_keeps_any_brightness(brightness: float) -> None:
    samples = random_samples(300, 3)
    transport = built([replace(samples, weight=samples.weight * brightness)])
    textures = torch.rand(2, ROWS, COLS, 3)
    exact, rounded = (TransportBatch.stack([t]).render(textures) for t in (transport, transport.half()))
    torch.testing.assert_close(rounded, exact, rtol=1e-3, atol=0.0)


def test_file_returns_what_was_saved(tmp_path: Path) -> None:
    transport = built([random_samples(100, 3)]).half()
    transport.save(tmp_path / "a" / "view.safetensors")
    loaded = LightTransport.load(tmp_path / "a" / "view.safetensors")
    assert (loaded.parts, loaded.texture_shape) == (transport.parts, transport.texture_shape)
    for name in ("start", "texel", "weight", "scale", "background", "coverage", "guide"):
        assert torch.equal(getattr(loaded, name), getattr(transport, name))


@pytest.mark.parametrize("content", [b"", b"\x08\x00\x00\x00\x00\x00\x00\x00{broken}", b"x" * 5000])
def test_damaged_file_is_one_sentence(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "view.safetensors"
    path.write_bytes(content)
    with pytest.raises(AssetError, match=r"view\.safetensors"):
        LightTransport.load(path)


def test_seen_texels_are_those_with_weight() -> None:
    samples = TransportSamples(torch.tensor([3]), torch.tensor([2]), torch.tensor([[0.25, 0.5]]), torch.ones(1, 3))
    seen = built([samples]).seen_texels()
    assert seen[0].sum() == 0
    torch.testing.assert_close(seen[1].sum(), torch.tensor(1.0))
