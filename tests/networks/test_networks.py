"""Networks: sizes, ranges, and what the thesis says of their shape."""

from __future__ import annotations

import pytest
import torch
from torch import nn

from svbrdfgan.networks.discriminator import Discriminator
from svbrdfgan.networks.generator import Generator, PreActConv, ResidualBlock, Upsampling
from svbrdfgan.networks.layers import Norm, initialise


@pytest.mark.parametrize("size", [(16, 16), (32, 64)])
@pytest.mark.parametrize("norm", ["instance", "group", "pixel", "none"])
def test_layer_has_the_buffer_s_size_and_range(size: tuple[int, int], norm: str) -> None:
    layer = Generator(width=4, norm=norm)(torch.randn(2, 6, *size))
    assert layer.shape == (2, *size, 4)
    assert 0 < layer.min() <= layer.max() < 1


def test_a_layer_has_a_channel_for_each_value_of_its_maps() -> None:
    assert Generator(width=4, blocks=0, maps=("roughness", "metallic"))(torch.randn(1, 6, 16, 16)).shape == (
        1,
        16,
        16,
        6,
    )


def sheet(rows: int, cols: int) -> torch.Tensor:
    """Position and normal of a flat sheet of 2 x 2 units in x and y, for networks."""
    y, x = torch.meshgrid(*((torch.arange(n) + 0.5) * 2 / n - 1 for n in (rows, cols)), indexing="ij")
    flat = torch.zeros(rows, cols)
    return torch.stack([x, y, flat, flat, flat, flat + 1])[None]


@pytest.mark.parametrize("gloss", [(), ("roughness",), ("roughness", "metallic")])
def test_normals_are_flat_at_first_and_may_tilt_to_all_sides(gloss: tuple[str, ...]) -> None:
    generator = Generator(width=4, blocks=0, maps=(*gloss, "normal"))
    initialise(generator, torch.Generator().manual_seed(0))
    geometry = sheet(16, 16) + 0.1 * torch.randn(1, 6, 16, 16)
    with torch.no_grad():
        generator.last.convolve.weight *= 1e-3
        first = generator(geometry)
        torch.testing.assert_close(first[..., -3:], torch.tensor([0, 0, 1.0]).expand(1, 16, 16, 3), atol=0.02, rtol=0)
        others = torch.full((4 + len(gloss),), 0.5)
        if "metallic" in gloss:
            others[-1] = 0.0474  # metallic, after roughness
        torch.testing.assert_close(first[..., :-3], others.expand(1, 16, 16, -1), atol=0.02, rtol=0)
        generator.last.convolve.weight *= 1e7
        painted = generator(geometry)
    assert painted[..., -3:-1].min() < -0.9
    assert painted[..., -3:-1].max() > 0.9
    assert painted[..., -1].min() >= 0.0
    assert painted[..., :-3].min() >= 0.0


def test_training_starts_with_normals_that_lean_by_a_few_degrees() -> None:
    """Relief leans by a few, too."""
    generator = Generator(width=16, blocks=2, maps=("roughness", "metallic", "normal"), random_fields=5, skips=True)
    initialise(generator, torch.Generator().manual_seed(0))
    with torch.no_grad():
        normal = generator(sheet(128, 128), torch.tensor([0]))[..., -3:]
    lean = torch.atan2(normal[..., :2].norm(dim=-1), normal[..., 2]).mean().rad2deg()
    assert 0.1 < lean < 8.0


def test_thesis_generator() -> None:
    generator = Generator(upsampling="strided")
    assert sum(isinstance(m, ResidualBlock) for m in generator.modules()) == 6
    assert sum(isinstance(m, nn.ConvTranspose2d) for m in generator.modules()) == 2
    weights = [m.weight for m in generator.modules() if isinstance(m, nn.Conv2d)]
    assert weights[0].shape == (64, 6, 7, 7)
    assert weights[-1].shape[0] == 4


@pytest.mark.parametrize(("downsamplings", "upsampling"), [(1, "nearest"), (3, "strided"), (4, "nearest")])
def test_more_downsamplings_keep_the_blocks(downsamplings: int, upsampling: Upsampling) -> None:
    """With half the width for each, blocks have the channels and the resolution that they had for fewer texels."""
    generator = Generator(4 << (4 - downsamplings), 1, downsamplings, upsampling=upsampling, random_fields=2)
    block = generator.blocks[0]
    assert isinstance(block, ResidualBlock)
    assert block.first.convolve.in_channels == 64
    sizes: list[torch.Size] = []
    block.first.convolve.register_forward_hook(lambda _module, _given, result: sizes.append(result.shape[-2:]))
    side = 8 << downsamplings
    assert generator(torch.randn(1, 6, side, side), torch.tensor([3])).shape == (1, side, side, 4)
    assert sizes == [(8, 8)]


def test_skips_carry_what_is_as_fine_as_a_texel() -> None:
    """Where the blocks end in nothing, the finest features still reach the layer; without skips nothing does."""
    made = []
    for skips in (False, True):
        generator = Generator(8, 1, 2, skips=skips)
        for up in generator.up:
            nn.init.zeros_(up.convolve.weight)
        made.append(generator(torch.randn(1, 6, 16, 16, generator=torch.Generator().manual_seed(0))))
    assert made[0].std(dim=(1, 2)).max() == 0
    assert (made[1][:, 1:] - made[1][:, :-1]).abs().mean() > 1e-3


@pytest.mark.parametrize(("layers", "patch"), [(1, 16), (2, 34), (3, 70)])
def test_patch_is_as_large_as_said(layers: int, patch: int) -> None:
    critic = Discriminator(channels=1, width=4, layers=layers)
    for parameter in critic.parameters():
        nn.init.constant_(parameter, 0.01)
    picture = torch.zeros(1, 1, 160, 160, requires_grad=True)
    logits = critic(picture)
    middle = logits.shape[-1] // 2
    (gradient,) = torch.autograd.grad(logits[0, middle, middle], picture)
    touched = torch.nonzero(gradient[0, 0].abs().sum(dim=0)).flatten()
    assert int(touched.max() - touched.min()) + 1 == patch


@pytest.mark.parametrize("make", [Generator, Discriminator])
@pytest.mark.parametrize("batch", [1, 2])
def test_gradients_do_not_depend_on_the_layout_in_memory(make: type[nn.Module], batch: int) -> None:
    """torch's own instance norm fails this for one sample on the CPU."""
    options = {"upsampling": "strided"} if make is Generator else {"channels": 6}
    network = make(width=4, norm="instance", **options).double()
    picture = torch.randn(batch, 6, 32, 32, dtype=torch.float64)
    slope = torch.randn_like(network(picture))
    gradients = []
    for layout in (torch.contiguous_format, torch.channels_last):
        result = network.to(memory_format=layout)(picture.contiguous(memory_format=layout))
        gradients.append(torch.autograd.grad(result, list(network.parameters()), slope))
    for one, other in zip(*gradients, strict=True):
        torch.testing.assert_close(one, other)


@pytest.mark.parametrize(("norm", "biased"), [("instance", 1), ("group", 8), ("pixel", 8), ("none", 8)])
def test_only_the_last_convolution_has_a_bias_if_a_norm_would_take_it_out(norm: str, biased: int) -> None:
    convolutions = [m for m in Generator(width=4, blocks=1, norm=norm).modules() if isinstance(m, nn.Conv2d)]
    assert len(convolutions) == 8
    assert sum(m.bias is not None for m in convolutions) == biased


def test_initial_weights_depend_on_the_seed_alone() -> None:
    def weights(seed: int) -> torch.Tensor:
        generator = Generator(width=4)
        initialise(generator, torch.Generator().manual_seed(seed))
        return torch.cat([p.flatten() for p in generator.parameters()])

    assert torch.equal(weights(1), weights(1))
    assert not torch.equal(weights(1), weights(2))


def _drawing(seed: int = 0, **options: int) -> Generator:
    """A generator with random fields and one label, as it might be after some training."""
    generator = Generator(width=8, blocks=1, **{"random_fields": 3, "labels": 1, **options})
    rng = torch.Generator().manual_seed(seed)
    initialise(generator, rng)
    with torch.no_grad():
        for parameter in generator.modulation.parameters() if generator.modulation else ():
            parameter += 0.3 * torch.randn(parameter.shape, generator=rng)
    return generator.requires_grad_(False)


def test_chance_and_labels_change_the_layer() -> None:
    generator, geometry, label = _drawing(), torch.rand(1, 6, 32, 32), torch.zeros(1, 1)
    layer = generator(geometry, torch.tensor([1]), label)
    assert torch.equal(generator(geometry, torch.tensor([1]), label), layer)
    assert not torch.equal(generator(geometry, torch.tensor([2]), label), layer)
    assert not torch.equal(generator(geometry, torch.tensor([1]), label + 1), layer)


def test_a_layer_does_not_depend_on_the_others_of_its_batch() -> None:
    generator, geometry = _drawing(), torch.rand(3, 6, 32, 32)
    seeds, labels = torch.tensor([4, 5, 6]), torch.tensor([[-1.0], [0.0], [1.0]])
    each = [generator(geometry[n : n + 1], seeds[n : n + 1], labels[n : n + 1])[0] for n in range(3)]
    torch.testing.assert_close(generator(geometry, seeds, labels), torch.stack(each), atol=1e-5, rtol=1e-5)


def test_a_generator_starts_as_a_function_of_geometry_and_fields() -> None:
    """Its code changes nothing before a step of training."""
    generator, geometry = Generator(width=4, blocks=1, labels=2), torch.rand(1, 6, 16, 16)
    initialise(generator, torch.Generator().manual_seed(0))
    plain = Generator(width=4, blocks=1)
    initialise(plain, torch.Generator().manual_seed(0))
    assert torch.equal(generator(geometry, labels=torch.ones(1, 2)), plain(geometry))


def test_without_chance_nothing_is_built_for_it() -> None:
    names = set(Generator(width=4, blocks=1).state_dict())
    assert names < set(Generator(width=4, blocks=1, random_fields=2).state_dict())
    assert not any(name.startswith("modulation") for name in names)


def _asked() -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Two geometries, seeds and labels of `_drawing`."""
    rng = torch.Generator().manual_seed(0)
    return torch.rand(2, 6, 32, 32, generator=rng), torch.tensor([1, 2]), torch.tensor([[0.5], [-0.5]])


def test_a_finer_layer_has_the_coarse_one_at_its_texels_centres() -> None:
    generator, (geometry, seeds, labels) = _drawing(), _asked()
    coarse, fine = (generator(geometry, seeds, labels, factor) for factor in (1, 3))
    assert fine.shape == (2, 96, 96, 4)
    torch.testing.assert_close(fine[:, 1::3, 1::3], coarse)


@pytest.mark.parametrize("norm", ["instance", "group", "pixel", "none"])
def test_a_convolution_at_a_factor_of_one_is_the_convolution(norm: Norm) -> None:
    last, x = PreActConv(nn.Conv2d(4, 3, 7), norm, pad=3).eval(), torch.randn(2, 4, 16, 16)
    torch.testing.assert_close(last.finer(x, 1), last(x))


def test_a_finer_convolution_keeps_the_scale() -> None:
    """Convolving interpolated features with taps as far apart as before; the borders reflect."""
    last, x = PreActConv(nn.Conv2d(4, 3, 7), "instance", pad=3), torch.randn(1, 4, 16, 16)
    features = nn.functional.pad(nn.functional.instance_norm(x), (4,) * 4, mode="reflect")
    fine = nn.functional.interpolate(features, scale_factor=4, mode="bilinear")[:, :, 4:-4, 4:-4].relu()
    wanted = nn.functional.conv2d(fine, last.convolve.weight, last.convolve.bias, dilation=4)
    torch.testing.assert_close(last.finer(x, 4), wanted, atol=1e-5, rtol=1e-5)


def test_a_finer_layer_has_no_grid() -> None:
    """Neighbours differ as much within texels of the trained resolution as across their borders."""
    generator, (_, seeds, labels) = _drawing(), _asked()
    corners = torch.rand(2, 6, 4, 4, generator=torch.Generator().manual_seed(0))
    geometry = nn.functional.interpolate(corners, size=(32, 32), mode="bicubic")
    step = generator(geometry, seeds, labels, 4).diff(dim=1).abs().mean(dim=(0, 2, 3))
    by_place = torch.stack([step[place::4].mean() for place in range(4)])
    assert by_place.max() < 1.3 * by_place.mean()


def test_he_s_weights_keep_the_size_of_what_the_discriminator_sees() -> None:
    sizes = {}
    for weights in ("normal", "he"):
        critic = Discriminator(channels=9)
        initialise(critic, torch.Generator().manual_seed(0), weights)
        with torch.no_grad():
            sizes[weights] = float(critic(torch.randn(2, 9, 64, 64, generator=torch.Generator().manual_seed(0))).std())
    assert sizes["normal"] < 0.3 < 0.5 < sizes["he"] < 2.0
