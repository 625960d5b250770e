"""FLIP: zero for equal pictures, more for what looks more different."""

from __future__ import annotations

import torch

from svbrdfgan.metrics.flip import display, flip


def a_picture() -> torch.Tensor:
    return torch.rand(24, 20, 3, generator=torch.Generator().manual_seed(0))


def test_equal_pictures_have_none() -> None:
    assert flip(a_picture(), a_picture()) == 0.0


def test_black_and_white_are_far_apart() -> None:
    black, white = torch.zeros(24, 24, 3), torch.ones(24, 24, 3)
    assert 0.9 < flip(black, white) <= 1.0


def test_more_noise_is_more() -> None:
    picture = a_picture() * 0.5 + 0.25
    noise = torch.randn(picture.shape, generator=torch.Generator().manual_seed(1))
    errors = [flip(picture, (picture + scale * noise).clamp(0, 1)) for scale in (0.0, 0.02, 0.1, 0.3)]
    assert errors == sorted(errors)
    assert errors[1] > 0


def test_displayed_before_grey() -> None:
    shown = display(torch.zeros(2, 2, 3), background=0.5, coverage=torch.tensor([[0.0, 1.0], [0.0, 1.0]]))
    assert (shown[:, 1] == 0).all()
    torch.testing.assert_close(shown[:, 0], torch.full((2, 3), 0.7354), atol=1e-3, rtol=0)
    torch.testing.assert_close(display(torch.full((1, 1, 3), 50.0)), torch.ones(1, 1, 3))
