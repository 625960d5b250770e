"""Laying layers over materials and pictures over backgrounds."""

from __future__ import annotations

import torch

from svbrdfgan.compositing import composite, over


def test_clear_shows_the_base_and_opaque_the_layer() -> None:
    base, color = torch.rand(4, 5, 3), torch.rand(4, 5, 3)
    clear, opaque = (torch.cat([color, torch.full((4, 5, 1), alpha)], dim=-1) for alpha in (0.0, 1.0))
    assert torch.equal(composite(base, clear), base)
    torch.testing.assert_close(composite(base, opaque), color, atol=1e-7, rtol=0)


def test_straight_alpha_mixes_linearly() -> None:
    mixed = composite(torch.tensor([1.0, 0.0, 0.5]), torch.tensor([0.0, 1.0, 0.5, 0.25]))
    torch.testing.assert_close(mixed, torch.tensor([0.75, 0.25, 0.5]))


def test_a_constant_base_broadcasts() -> None:
    base, layer = torch.rand(3), torch.rand(2, 4, 5, 4)
    assert torch.equal(composite(base, layer), composite(base.expand(2, 4, 5, 3), layer))


def test_two_layers_are_one_of_their_union() -> None:
    """Porter and Duff's over: a2 + a1 (1 - a2)."""
    base, first, second = torch.rand(3), torch.rand(4), torch.rand(4)
    alpha = second[3] + first[3] * (1 - second[3])
    color = (second[:3] * second[3] + first[:3] * first[3] * (1 - second[3])) / alpha
    torch.testing.assert_close(
        composite(composite(base, first), second), composite(base, torch.cat([color, alpha[None]]))
    )


def test_composite_is_differentiable() -> None:
    inputs = [torch.rand(2, 3, 3).double().requires_grad_(True), torch.rand(2, 3, 4).double().requires_grad_(True)]
    assert torch.autograd.gradcheck(composite, inputs)


def test_over_shows_the_background_where_nothing_covers() -> None:
    image, background = torch.rand(4, 5, 3), torch.rand(3)
    covered, bare = torch.ones(4, 5), torch.zeros(4, 5)
    assert torch.equal(over(image, covered, background), image)
    torch.testing.assert_close(over(torch.zeros(4, 5, 3), bare, background), background.expand(4, 5, 3))


def test_over_leaves_radiance_above_one_alone() -> None:
    image = torch.full((1, 1, 3), 40.0)
    torch.testing.assert_close(over(image, torch.tensor([[0.5]]), torch.ones(3)), torch.full((1, 1, 3), 40.5))
