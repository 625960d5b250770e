"""Modulation: a code changes nothing at first, and afterwards every convolution's input as a scale and a shift."""

from __future__ import annotations

import torch

from svbrdfgan.networks.layers import initialise
from svbrdfgan.networks.modulation import Affine, Modulation


def test_affine_scales_and_shifts_each_channel() -> None:
    features = torch.randn(2, 3, 4, 5)
    values = torch.randn(2, 6)
    wanted = features * (1 + values[:, :3, None, None]) + values[:, 3:, None, None]
    torch.testing.assert_close(Affine(values)(features), wanted)


def test_it_starts_as_the_identity_and_learns() -> None:
    modulation = Modulation(3, (4, 2))
    initialise(modulation, torch.Generator().manual_seed(0))
    code, features = torch.randn(2, 3), torch.randn(2, 4, 8, 8)
    first, second = modulation(code)
    assert torch.equal(first(features), features)
    (second(features[:, :2]).square().mean() + first(features).mean()).backward()
    for parameter in (modulation.weight, modulation.bias):
        assert parameter.grad is not None
        assert parameter.grad.abs().sum() > 0


def test_its_first_weights_depend_on_the_seed_alone() -> None:
    def weights(seed: int) -> torch.Tensor:
        modulation = Modulation(3, (4,))
        initialise(modulation, torch.Generator().manual_seed(seed))
        return torch.cat([p.flatten() for p in modulation.parameters()])

    assert torch.equal(weights(1), weights(1))
    assert not torch.equal(weights(1), weights(2))
