"""Layers that are refined are painted once for each seed, and are what painting them each time would give."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from svbrdfgan.networks.generator import Generator
from svbrdfgan.networks.inputs import Inputs, Wholes, window_of
from svbrdfgan.training.refined_layers import SEEDS, RefinedLayers, kept_bytes

PLACES = [(0.0, 0.0, 0.25, 0.25), (0.75, 0.75, 0.25, 0.25), (0.3125, 0.53, 0.25, 0.25), (0.01, 0.7, 0.25, 0.25)]


@pytest.fixture
def generator() -> Generator:
    torch.manual_seed(0)
    coarse = Generator(width=4, blocks=1, random_fields=2, labels=1, maps=("roughness",))
    return Generator(width=4, blocks=1, norm="pixel", random_fields=2, labels=1, maps=("roughness",), refined=coarse)


@pytest.fixture
def inputs() -> Inputs:
    rng = torch.Generator().manual_seed(1)
    wholes = Wholes(torch.randn(2, 6, 64, 64, generator=rng), torch.tensor([0, 1, 1, 0]), torch.tensor(PLACES))
    return Inputs(torch.randn(4, 6, 32, 32, generator=rng), wholes)


LABELS = torch.tensor([[0.1], [0.5], [0.9], [-0.3]])


def test_they_are_those_of_the_whole_maps(generator: Generator, inputs: Inputs) -> None:
    refined = RefinedLayers(generator)
    seeds = refined.draw(range(4), np.random.default_rng(0))
    assert [seed // SEEDS for seed in seeds] == [0, 1, 2, 3]
    assert inputs.wholes is not None
    whole = generator.refined_layers(inputs.wholes.geometry[inputs.wholes.of], torch.tensor(seeds), LABELS)
    wanted = window_of(whole, inputs.wholes.place, 32, 32)
    found = refined.windows(inputs, seeds, LABELS)
    assert torch.allclose(found, wanted, atol=1e-3)
    assert not torch.allclose(found[0], found[3], atol=1e-2)
    kept = sum(values.nbytes for values, _ in refined._kept.values())
    assert kept * SEEDS == kept_bytes(exemplars=4, side=16, channels=5)


@pytest.mark.parametrize("most_bytes", [1 << 20, 12_000, 0])
def test_they_are_painted_once_if_they_may_be_kept(
    most_bytes: int, generator: Generator, inputs: Inputs, monkeypatch: pytest.MonkeyPatch
) -> None:
    refined, painted, paint = RefinedLayers(generator, most_bytes), [0], generator.refined_layers

    def counted(*given: torch.Tensor) -> torch.Tensor:
        painted[0] += 1
        return paint(*given)

    monkeypatch.setattr(generator, "refined_layers", counted)
    first = refined.windows(inputs, [3, 18, 40, 50], LABELS)
    assert torch.equal(refined.windows(inputs, [3, 18, 40, 50], LABELS), first)
    assert painted == {1 << 20: [4], 0: [8]}.get(most_bytes, [6])
    alone = refined.windows(inputs.pick([2]), [40], LABELS[2:3])
    assert torch.equal(alone, first[2:3]), "whatever the batch"
