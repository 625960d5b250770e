"""Light transport: the algebra, the merging and the file. Renderers are compared with it in their own tests."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from svbrdfgan.errors import AssetError
from svbrdfgan.geometry.texels import Repeat, sample_texture
from svbrdfgan.rendering.transport import build as build_module
from svbrdfgan.rendering.transport.build import build_transport
from svbrdfgan.rendering.transport.light_transport import LightTransport
from svbrdfgan.rendering.transport.product import TransportBatch
from svbrdfgan.types import Camera, Environment, Material, Materials, TransportSamples, View

ROWS, COLS, SPP = 8, 6, 4
Change = Callable[[torch.Tensor], torch.Tensor]
PAINT, GLASS = Material.lambertian((0.5, 0.4, 0.3)), Material.lambertian((0.1, 0.1, 0.2))


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


def built(
    chunks: list[TransportSamples],
    learnable: tuple[int, ...] = (0, 2),
    gbuffer: torch.Tensor | None = None,
    repeat: Repeat = (False, False),
) -> LightTransport:
    gbuffer = torch.rand(ROWS, COLS, 6) if gbuffer is None else gbuffer
    return build_transport(
        chunks, materials=three_parts(), learnable=learnable, gbuffer=gbuffer, view=a_view(), spp=SPP, repeat=repeat
    )


def splatted(samples: TransportSamples, colors: list[torch.Tensor], repeat: Repeat = (False, False)) -> torch.Tensor:
    """The definition of `TransportSamples`, written out."""
    image = torch.zeros(15, 3)
    for n in range(len(samples.pixel)):
        color = colors[int(samples.part[n])]
        value = color if color.ndim == 1 else sample_texture(color, samples.uv[n : n + 1], repeat)[0]
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


@pytest.mark.parametrize("chunks", [0, 1])
def test_no_samples_at_all_is_a_black_picture(chunks: int) -> None:
    empty = TransportSamples(torch.zeros(0).long(), torch.zeros(0).long(), torch.zeros(0, 2), torch.zeros(0, 3))
    transport = built([empty] * chunks)
    picture = TransportBatch.stack([transport]).render(torch.ones(2, ROWS, COLS, 3))
    assert (picture == 0).all()
    assert (transport.coverage == 0).all()


@pytest.mark.parametrize("repeat", [(False, False), (True, False), (True, True)])
def test_the_gbuffer_is_what_learnable_samples_see(repeat: Repeat) -> None:
    samples, gbuffer = random_samples(400, 3), torch.randn(ROWS, COLS, 6, generator=torch.Generator().manual_seed(3))
    transport = built([samples], gbuffer=gbuffer, repeat=repeat)
    learnable = samples.part != 1
    expected = torch.zeros(15, 6)
    expected.index_add_(0, samples.pixel[learnable], sample_texture(gbuffer, samples.uv[learnable], repeat) / SPP)
    torch.testing.assert_close(transport.gbuffer.reshape(-1, 6), expected, rtol=1e-5, atol=1e-5)


def test_the_seam_repeats_along_the_given_axes() -> None:
    samples, textures = random_samples(300, 3), torch.rand(2, ROWS, COLS, 3)
    for repeat in ((True, False), (False, True)):
        picture = TransportBatch.stack([built([samples], repeat=repeat)]).render(textures)[0]
        colors = [textures[0], GLASS.base_color, textures[1]]
        torch.testing.assert_close(picture, splatted(samples, colors, repeat), rtol=1e-5, atol=1e-5)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="there is no CUDA device")
def test_cuda_builds_what_the_cpu_builds_and_the_same_bits_each_time() -> None:
    chunks = [random_samples(3000, 3, seed=n) for n in range(3)]
    there = [TransportSamples(**{name: value.cuda() for name, value in vars(chunk).items()}) for chunk in chunks]
    gbuffer = torch.rand(ROWS, COLS, 6, generator=torch.Generator().manual_seed(4))
    expected, once, twice = built(chunks, gbuffer=gbuffer), built(there, gbuffer=gbuffer), built(there, gbuffer=gbuffer)
    for name in ("start", "texel", "weight", "background", "coverage", "gbuffer"):
        assert torch.equal(getattr(once, name), getattr(twice, name))
        torch.testing.assert_close(getattr(once, name).cpu(), getattr(expected, name), rtol=1e-5, atol=1e-5)


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
    for name in ("start", "texel", "weight", "scale", "background", "coverage", "gbuffer"):
        assert torch.equal(getattr(loaded, name), getattr(transport, name))


@pytest.mark.parametrize("content", [b"", b"\x08\x00\x00\x00\x00\x00\x00\x00{broken}", b"x" * 5000])
def test_damaged_file_is_one_sentence(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "view.safetensors"
    path.write_bytes(content)
    with pytest.raises(AssetError, match=r"view\.safetensors"):
        LightTransport.load(path)


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("texel", lambda t: t + 96),
        ("texel", lambda t: t - 96),
        ("texel", lambda t: t.long()),
        ("start", lambda t: t + 1),
        ("start", lambda t: t.flip(0)),
        ("start", lambda t: t[1:]),
        ("weight", lambda t: t[1:]),
        ("weight", lambda t: t.double()),
        ("gbuffer", lambda t: t[..., :3]),
    ],
)
def test_a_file_that_leads_out_of_its_arrays_is_refused(name: str, change: Change, tmp_path: Path) -> None:
    transport = built([random_samples(100, 3)]).half()
    replace(transport, **{name: change(getattr(transport, name))}).save(tmp_path / "view.safetensors")
    with pytest.raises(AssetError, match=name):
        LightTransport.load(tmp_path / "view.safetensors")


def test_half_precision_states_its_error() -> None:
    transport = built([random_samples(3000, 3)])
    spread = 10.0 ** torch.empty_like(transport.weight).uniform_(-14, 3, generator=torch.Generator().manual_seed(6))
    weight = transport.weight * spread
    half = replace(transport, weight=weight).half()
    error = (half.weight.double() * half.scale.double() - weight.double()).abs()
    bound = torch.maximum(weight.double() * 2.0**-11, weight.max().double() * 2.0**-40)
    assert (error <= bound * (1 + 1e-3)).all()
    assert half.nbytes < 0.8 * transport.nbytes


def test_seen_texels_are_those_with_weight() -> None:
    samples = TransportSamples(torch.tensor([3]), torch.tensor([2]), torch.tensor([[0.25, 0.5]]), torch.ones(1, 3))
    seen = built([samples]).seen_texels()
    assert seen[0].sum() == 0
    torch.testing.assert_close(seen[1].sum(), torch.tensor(1.0))
