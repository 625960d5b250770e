"""Random fields: the same bits for a seed on any machine, even statistics, and no seams."""

from __future__ import annotations

import hashlib

import pytest
import torch
from torch import Tensor

from svbrdfgan.networks.random_fields import MOST_FIELDS, random_fields, random_numbers


def positions(batch: int, side: int = 32) -> Tensor:
    """In the box of a generator's input, evenly spread."""
    drawn = torch.rand(batch, 3, side, side, generator=torch.Generator().manual_seed(0))
    return drawn * torch.tensor([1.0, 0.8, 2.0]).view(3, 1, 1) - torch.tensor([0.5, 0.0, 1.0]).view(3, 1, 1)


def digest(values: Tensor) -> str:
    return hashlib.sha256(values.contiguous().numpy().tobytes()).hexdigest()[:16]


def lattice(side: int) -> Tensor:
    """Positions without a random generator, which another version of torch might change."""
    steps = torch.arange(3 * side * side, dtype=torch.float64) * 0.6180339887498949
    return (2.0 * (steps % 1.0) - 1.0).float().view(1, 3, side, side)


def test_a_seed_s_field_is_fixed_to_the_bit() -> None:
    fields = random_fields(lattice(16).expand(3, -1, -1, -1), torch.tensor([0, 7, 2**63 - 1]), MOST_FIELDS)
    assert fields.dtype == torch.float32
    assert digest(fields) == "3d29f67f7e2043af"
    assert digest(random_numbers(torch.tensor([0, 7, 2**63 - 1]), 16)) == "cae4600c816b0554"


def test_fields_have_mean_zero_and_standard_deviation_one() -> None:
    fields = random_fields(positions(256, 16), torch.arange(256), MOST_FIELDS)
    torch.testing.assert_close(fields.std(dim=(0, 2, 3)), torch.ones(MOST_FIELDS), atol=0.04, rtol=0)
    torch.testing.assert_close(fields.mean(dim=(0, 2, 3)), torch.zeros(MOST_FIELDS), atol=0.05, rtol=0)


def test_fields_of_seeds_and_octaves_are_independent() -> None:
    """Near seeds, too."""
    fields = random_fields(positions(1, 64).expand(8, -1, -1, -1), torch.arange(8), MOST_FIELDS)[:, 3:]
    correlations = torch.corrcoef(fields.flatten(0, 1).flatten(1))
    assert (correlations - torch.eye(len(correlations))).abs().max() < 0.1


def test_a_field_is_a_function_of_the_position_alone() -> None:
    """So it continues across the seams of a texture."""
    position, seed = positions(1), torch.tensor([5])
    fields = random_fields(position, seed, 6)
    elsewhere = random_fields(position.flip(-1).transpose(-1, -2), seed, 6)
    assert torch.equal(elsewhere.transpose(-1, -2).flip(-1), fields)
    assert torch.equal(random_fields(position, torch.tensor([5]), 4), fields[:, :4])


@pytest.mark.parametrize("octave", range(4))
def test_each_octave_has_twice_the_waves(octave: int) -> None:
    """Gradient noise crosses zero about once in each cell of its lattice; a vehicle is two units long."""
    along = torch.linspace(-1.0, 1.0, 4001)
    position = torch.stack([torch.full_like(along, 0.31), torch.full_like(along, 0.17), along])[None, :, None]
    values = random_fields(position.expand(64, -1, -1, -1), torch.arange(64), 4)[:, octave, 0]
    crossings = (values[:, 1:] * values[:, :-1] < 0).sum(dim=1).float().mean()
    assert 0.6 < crossings / 2 ** (octave + 1) < 1.4
    assert values.diff(dim=1).abs().max() < 5e-3 * 2**octave, "it is continuous"


def test_numbers_are_nearly_gaussian_and_independent() -> None:
    numbers = random_numbers(torch.arange(20000), 8)
    assert numbers.mean(dim=0).abs().max() < 0.03
    torch.testing.assert_close(torch.cov(numbers.T), torch.eye(8), atol=0.05, rtol=0)
    assert 0.0015 < (numbers.abs() > 3).float().mean() < 0.0035


def test_tables_of_large_maps_give_the_same_bits() -> None:
    smooth = torch.nn.functional.interpolate(positions(2, 3), (150, 140), mode="bilinear", align_corners=True)
    position = torch.cat([smooth, 0.02 * smooth, positions(1, 150)[..., :140]])  # of the last no table is made
    seeds = torch.tensor([0, 7, 2**40, 2**62, 2**63 - 1])
    whole = random_fields(position, seeds, MOST_FIELDS)
    strips = [random_fields(strip, seeds, MOST_FIELDS) for strip in position.split(50, dim=2)]  # too small for tables
    assert torch.equal(whole, torch.cat(strips, dim=2))


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
def test_a_gpu_gives_the_same_bits() -> None:
    position, seeds = positions(2), torch.tensor([3, 2**40])
    onto = random_fields(position.cuda(), seeds.cuda(), MOST_FIELDS)
    assert torch.equal(onto.cpu(), random_fields(position, seeds, MOST_FIELDS))
    assert torch.equal(random_numbers(seeds.cuda(), 16).cpu(), random_numbers(seeds, 16))
