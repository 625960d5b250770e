"""Octaves of textures: powers add up to the variance over the surface, and patches stay on one part."""

import pytest
import torch
import torch.nn.functional as F

from svbrdfgan.metrics.texture_pyramid import octave_count, octaves, patch_areas, pooled, premultiplied
from svbrdfgan.types import Layer


@pytest.fixture
def weight() -> torch.Tensor:
    """Areas that differ, with holes."""
    rng = torch.Generator().manual_seed(0)
    return torch.rand(32, 32, generator=rng) * (torch.rand(32, 32, generator=rng) > 0.3)


def test_powers_add_up_to_the_variance_over_the_surface(weight: torch.Tensor) -> None:
    values = torch.rand(3, 2, 32, 32, generator=torch.Generator().manual_seed(1))
    found = octaves(values, weight)
    coarsest = pooled(found[-1].values, found[-1].weight)
    area = F.avg_pool2d(found[-1].weight[None], 2)[0]
    rest = (coarsest.square() * (area / area.sum())).sum(dim=(2, 3)).mean(dim=0)
    whole = (values.square() * (weight / weight.sum())).sum(dim=(2, 3)).mean(dim=0)
    torch.testing.assert_close(sum(octave.power() for octave in found) + rest, whole)


def test_what_is_not_scored_changes_nothing(weight: torch.Tensor) -> None:
    values = torch.rand(2, 1, 32, 32, generator=torch.Generator().manual_seed(2))
    for one, other in zip(octaves(values, weight), octaves(values + 9 * (weight == 0), weight), strict=True):
        assert torch.equal(one.detail, other.detail)
        assert torch.equal(one.blocks()[0], other.blocks()[0])


def test_a_pattern_of_one_octave_has_its_power_there() -> None:
    checks = (torch.arange(32) // 4 % 2).float()  # 4 texels on, 4 off: of blocks of 8, so octave 2
    found = octaves(checks.expand(1, 1, 32, 32), torch.ones(32, 32))
    assert [float(octave.power()) for octave in found] == [0.0, 0.0, 0.25]


def test_a_texture_is_halved_while_its_sides_are_even_and_large() -> None:
    assert [octave_count(*size) for size in ((128, 128), (16, 8), (24, 48), (18, 18), (15, 64))] == [5, 1, 2, 1, 0]


def test_patches_lie_on_scored_texels_of_one_part() -> None:
    part, weight = torch.zeros(16, 16, dtype=torch.int32), torch.ones(16, 16)
    part[:, 8:], weight[:8] = 1, 0.0
    fine, coarse = patch_areas(part, weight, 3)
    rows, cols = (fine.reshape(14, 14) > 0).nonzero().T
    assert set(rows.tolist()) == set(range(8, 14))
    assert set(cols.tolist()) == {*range(6), *range(8, 14)}
    assert coarse.reshape(6, 6).count_nonzero() == 8
    assert set(coarse[coarse > 0].tolist()) == {4.0}


def test_maps_count_by_alpha_and_normals_lose_z() -> None:
    layer = torch.tensor([0.4, 0.2, 0.0, 0.5, 0.8, 1.0, 0.6, 0.0, 0.8]).expand(2, 1, 1, 9)
    found = premultiplied(Layer(layer, ("roughness", "metallic", "normal")))
    torch.testing.assert_close(found[0, :, 0, 0], torch.tensor([0.5, 0.2, 0.1, 0.0, 0.4, 0.5, 0.3, 0.0]))
    assert premultiplied(Layer(layer[..., :5], ("roughness",))).shape == (2, 5, 1, 1)
