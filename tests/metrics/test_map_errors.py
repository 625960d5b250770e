"""Errors of maps: what is added, and the angles of normals."""

from __future__ import annotations

import math

import pytest
import torch
import torch.nn.functional as F
from torch import Tensor

from svbrdfgan.metrics.map_errors import angle, map_error, tilted


def normals() -> Tensor:
    """Directions with z >= 0, along and between all axes, of several lengths."""
    rng = torch.Generator().manual_seed(0)
    found = torch.cat([torch.eye(3), -torch.eye(3)[:2], torch.randn(200, 3, generator=rng)])
    found[:, 2] = found[:, 2].abs()
    return found * (0.1 + torch.rand(len(found), 1, generator=rng))


@pytest.mark.parametrize("degrees", [0.0, 0.01, 10.0, 90.0])
def test_a_tilt_is_the_angle_to_where_it_was(degrees: float) -> None:
    for turned in tilted(normals(), degrees):
        torch.testing.assert_close(angle(turned, normals()), torch.full((205,), degrees), atol=2e-4, rtol=1e-5)


def test_the_two_tilts_are_perpendicular() -> None:
    one, other = tilted(normals(), 90.0)
    torch.testing.assert_close((one * other).sum(-1), torch.zeros(205), atol=1e-6, rtol=0)
    assert tilted(torch.tensor([0.0, 0.0, 1.0]), 90.0)[0].tolist() == pytest.approx([1.0, 0.0, 0.0], abs=1e-6)


def test_length_does_not_count_and_no_length_is_flat() -> None:
    flat, tilt = torch.tensor([0.0, 0.0, 1.0]), torch.tensor([3.0, 0.0, 3.0])
    assert float(angle(flat, tilt)) == pytest.approx(45.0)
    assert float(angle(torch.zeros(3), tilt)) == pytest.approx(45.0)
    assert float(angle(flat, -flat)) == pytest.approx(180.0)


def test_the_gradient_of_an_angle_is_finite_even_at_none() -> None:
    made = F.normalize(normals(), dim=-1).requires_grad_(True)
    truth = made.detach().clone()
    truth[::2] = tilted(truth[::2], 1e-3)[0]
    angle(made, truth).sum().backward()
    assert made.grad is not None
    assert made.grad.isfinite().all()
    assert made.grad[::2].norm(dim=-1).min() == pytest.approx(180 / math.pi, rel=0.05)


def test_other_maps_differ_by_the_mean_of_their_channels() -> None:
    made, truth = torch.tensor([[0.5, 0.2, 0.9]]), torch.tensor([[0.2, 0.2, 1.0]])
    assert map_error("base_color", made, truth).tolist() == pytest.approx([0.4 / 3])
    assert map_error("roughness", made[:, :1], truth[:, :1]).tolist() == pytest.approx([0.3])
    assert map_error("normal", made, truth).tolist() == angle(made, truth).tolist()
