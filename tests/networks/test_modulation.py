"""Modulation: a code changes nothing at first, and afterwards the norm before every convolution by scale and shift."""

from __future__ import annotations

import torch

from svbrdfgan.networks.layers import initialise
from svbrdfgan.networks.modulation import Modulation


def test_it_starts_as_the_identity_and_learns() -> None:
    modulation = Modulation(3, (4, 2))
    initialise(modulation, torch.Generator().manual_seed(0))
    first, second = modulation(torch.randn(2, 3))
    assert torch.equal(first, torch.tensor([1.0, 0.0]).view(1, 2, 1).expand(2, 2, 4))
    assert second.shape == (2, 2, 2)
    (second.square().sum() + first[:, 0].sum()).backward()
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
