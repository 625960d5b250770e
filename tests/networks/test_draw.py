"""One draw of a generator is the generator at a fixed seed and fixed labels."""

from __future__ import annotations

import pytest
import torch

from svbrdfgan.networks.draw import Draw, opacity_of
from svbrdfgan.networks.generator import Generator
from svbrdfgan.networks.tiles import Windows


def test_a_draw_is_the_generator_at_its_seed_and_labels() -> None:
    generator, geometry = Generator(width=4, blocks=0, random_fields=2, labels=1), torch.rand(2, 6, 16, 16)
    wanted = generator(geometry, torch.tensor([7, 7]), torch.tensor([[0.5], [0.5]]))
    assert torch.equal(Draw(generator, 7, [0.5])(geometry), wanted)
    assert not torch.equal(Draw(generator, 8, [0.5])(geometry), wanted)


def test_without_chance_it_is_the_generator_itself() -> None:
    generator, geometry = Generator(width=4, blocks=0), torch.rand(2, 6, 16, 16)
    assert torch.equal(Draw(generator)(geometry), generator(geometry))


def test_a_layer_fades_in_from_clean() -> None:
    assert [opacity_of(amount) for amount in (0.0, 0.025, 0.05, 1.0)] == [0.0, 0.5, 1.0, 1.0]
    generator, geometry = Generator(width=4, blocks=0, maps=("roughness",)).eval(), torch.rand(1, 6, 16, 16)
    with torch.no_grad():
        whole, faint = Draw(generator)(geometry), Draw(generator, opacity=0.4)(geometry)
    torch.testing.assert_close(faint[..., 3], 0.4 * whole[..., 3])
    assert torch.equal(faint[..., [0, 1, 2, 4]], whole[..., [0, 1, 2, 4]])


def test_a_finer_draw_is_the_generator_s_finer_layer() -> None:
    generator, geometry = Generator(width=4, blocks=0, random_fields=2, labels=1), torch.rand(1, 6, 16, 16)
    wanted = generator(geometry, torch.tensor([7]), torch.tensor([[0.5]]), 2)
    assert wanted.shape == (1, 32, 32, 4)
    assert torch.equal(Draw(generator, 7, [0.5])(geometry, 2), wanted)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
def test_a_gpu_paints_what_the_cpu_does() -> None:
    generator = Generator(width=24, blocks=4, norm="pixel", random_fields=9, labels=1, maps=("roughness",)).eval()
    draw, geometry = Draw(generator, 7, [0.5], windows=Windows(64, 2)), torch.rand(1, 6, 128, 128)
    with torch.no_grad():
        wanted = draw(geometry, 4)
        generator.cuda()
        found = draw(geometry, 4)
    assert found.device == geometry.device
    torch.testing.assert_close(found, wanted, rtol=0.0, atol=0.5 / 255)
