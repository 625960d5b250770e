"""Losses by their definitions and their optima; penalties by known gradients."""

from __future__ import annotations

import math

import pytest
import torch

from svbrdfgan.networks.losses import LOSSES, gradient_penalty, gradient_square


@pytest.mark.parametrize("name", sorted(LOSSES))
def test_each_player_wants_what_it_should(name: str) -> None:
    real, fake = torch.tensor([0.3], requires_grad=True), torch.tensor([0.2], requires_grad=True)
    (d_real, d_fake) = torch.autograd.grad(LOSSES[name].discriminator(real, fake), (real, fake))
    (g_fake,) = torch.autograd.grad(LOSSES[name].generator(lambda: real, fake), fake)
    assert d_real < 0, "the discriminator raises the logits of real pictures"
    assert d_fake > 0, "and lowers those of fakes"
    assert g_fake < 0, "which the generator raises"


def test_vanilla_is_cross_entropy() -> None:
    real, fake = torch.randn(5), torch.randn(5)
    expected = -(torch.sigmoid(real).log().mean() + (1 - torch.sigmoid(fake)).log().mean())
    torch.testing.assert_close(LOSSES["vanilla"].discriminator(real, fake), expected)
    assert math.isclose(float(LOSSES["vanilla"].generator(lambda: real, torch.zeros(3))), math.log(2), rel_tol=1e-6)


def test_lsgan_is_least_at_its_labels() -> None:
    assert LOSSES["lsgan"].discriminator(torch.ones(4), torch.zeros(4)) == 0
    assert LOSSES["lsgan"].generator(lambda: torch.zeros(4), torch.ones(4)) == 0


def test_wgan_is_a_difference_of_means() -> None:
    assert float(LOSSES["wgan"].discriminator(torch.tensor([1.0, 3.0]), torch.tensor([5.0]))) == 3.0


def test_relativistic_sees_differences_only() -> None:
    real, fake = torch.randn(6), torch.randn(6)
    loss = LOSSES["relativistic"].discriminator
    torch.testing.assert_close(loss(real, fake), loss(real + 10, fake + 10))


def test_gradient_square_of_a_linear_critic_is_its_slope() -> None:
    slope = torch.randn(2, 3, 3)
    critic = lambda x: (x * slope).sum(dim=(1, 2, 3))  # noqa: E731
    torch.testing.assert_close(gradient_square(critic, torch.randn(5, 2, 3, 3)), slope.square().sum())


def test_gradient_square_does_not_depend_on_the_picture_s_size() -> None:
    layer = torch.nn.Conv2d(3, 1, 4, stride=4)
    small, large = (gradient_square(layer, torch.randn(2, 3, size, size)) for size in (16, 64))
    torch.testing.assert_close(small, large)


@pytest.mark.parametrize("norm", [0.5, 1.0, 3.0])
def test_gradient_penalty_is_zero_at_slope_one(norm: float) -> None:
    slope = torch.randn(2, 3, 3)
    slope = slope / slope.norm() * norm
    critic = lambda x: (x * slope).sum(dim=(1, 2, 3)).reshape(-1, 1).expand(-1, 4)  # noqa: E731
    penalty = gradient_penalty(critic, torch.randn(5, 2, 3, 3), torch.randn(5, 2, 3, 3), torch.rand(5))
    torch.testing.assert_close(penalty, torch.tensor((norm - 1) ** 2), atol=1e-5, rtol=1e-4)


def test_penalties_reach_the_critic_s_weights() -> None:
    layer = torch.nn.Conv2d(2, 1, 3)
    critic = lambda x: layer(x).square()  # noqa: E731
    gradient_square(critic, torch.randn(4, 2, 5, 5)).backward()
    assert layer.weight.grad is not None
    assert layer.weight.grad.abs().sum() > 0
