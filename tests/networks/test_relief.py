"""Normals of a painted height are those of the raised surface, whatever the embedding."""

from __future__ import annotations

import pytest
import torch

from svbrdfgan.networks.relief import FINE_REACH, fine_relief, relief_normals


@pytest.mark.parametrize("shear", [0.0, 0.7])
@pytest.mark.parametrize("stretch", [1.0, 3.0])
def test_slopes_are_those_along_the_surface(shear: float, stretch: float) -> None:
    size = 32
    v, u = torch.meshgrid(*2 * [torch.arange(size) / size], indexing="ij")
    x, y = stretch * u + shear * v, v  # of a plane, in the frame of its tangent
    height = 0.2 * x - 0.1 * y
    normals = relief_normals(height[None], torch.stack([x, torch.zeros_like(x), y])[None], len(x))
    wanted = torch.tensor([-0.2, 0.1, 1.0]) / torch.tensor([-0.2, 0.1, 1.0]).norm()
    torch.testing.assert_close(normals[0, :-1, :-1], wanted.expand(size - 1, size - 1, 3))


@pytest.mark.parametrize("factor", [1, 3])
@pytest.mark.parametrize(("wave", "least", "most"), [(8, 0.95, 1.05), (30, 0.4, 0.6), (100, 0.0, 0.1)])
def test_fine_relief_has_no_broad_waves(factor: int, wave: int, least: float, most: float) -> None:
    place = torch.arange(400 * factor) / factor
    height = torch.sin(2.0 * torch.pi * place / wave).expand(1, 2, -1)
    inner = slice(FINE_REACH * factor, -FINE_REACH * factor)
    left = fine_relief(height, factor)[..., inner].std() / height[..., inner].std()
    assert least < left < most


def test_fine_relief_reaches_no_further() -> None:
    height = torch.zeros(1, 64, 64)
    height[:, 32, 32] = 1.0
    rows, cols = fine_relief(height)[0].abs().gt(1e-6).nonzero().T
    assert (rows.min(), rows.max(), cols.min(), cols.max()) == 2 * (32 - FINE_REACH, 32 + FINE_REACH)


def test_where_neighbours_lie_far_apart_it_is_flat() -> None:
    height, position = torch.zeros(1, 8, 8), torch.zeros(1, 3, 8, 8)
    position[:, 0] = torch.arange(8) / 8
    position[:, 1] = torch.arange(8)[:, None] / 8
    position[..., 4:] += 100.0
    height[..., 4:] = 0.5
    normals = relief_normals(height, position, 8)
    assert normals[..., :-1, :, 0].abs().max() < 0.01


def test_a_pole_has_bounded_slopes_and_gradients() -> None:
    height = (1e-3 * torch.randn(1, 8, 8, generator=torch.Generator().manual_seed(0))).requires_grad_()
    normals = relief_normals(height, torch.zeros(1, 3, 8, 8), 8)
    normals[..., 0].sum().backward()
    assert normals.isfinite().all()
    assert height.grad is not None
    assert height.grad.isfinite().all()
    assert normals[..., 2].min() > 0.9
