"""The baselines: no constant layer errs less in its map."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.metrics.constant_layer import best_constants, constant_layers
from svbrdfgan.metrics.recovered import Target, make_targets
from svbrdfgan.rendering.compositing import composite, composite_maps
from svbrdfgan.types import Layer

CPU = torch.device("cpu")


def everywhere(index: int) -> Tensor:
    return torch.ones(32, 32)


@pytest.fixture(scope="module")
def targets(tiny_exemplars: Exemplars) -> list[Target]:
    return make_targets(tiny_exemplars, everywhere, CPU)[0]


def test_the_constant_is_the_best(targets: list[Target]) -> None:
    """No grid point, and nothing in its neighbourhood, does better."""
    (constant,), rng = best_constants(targets), torch.Generator().manual_seed(0)
    found = _errors(targets, constant[None])[0]
    axis = torch.linspace(0, 1, 7)
    grid = torch.cartesian_prod(axis, axis, axis, axis)
    near = [constant + scale * torch.randn(200, 4, generator=rng) for scale in (0.3, 0.05, 0.01)]
    others = _errors(targets, torch.cat([grid, *near]).clamp(0, 1))
    assert found <= others.min() * 1.002


def test_a_constant_truth_is_found() -> None:
    layer = torch.tensor([0.3, 0.25, 0.2, 0.6])
    target = Target(0, Layer(layer.expand(8, 8, 4)), {"base_color": torch.rand(8, 8, 3)}, torch.ones(8, 8))
    assert float(target.errors(best_constants([target])[0])[0]) < 2e-3


def _errors(targets: list[Target], constants: Tensor) -> Tensor:
    """E of each constant, from its definition."""
    total = torch.zeros(len(constants))
    for target in targets:
        counted = target.weight > 0
        weight = target.weight[counted] / target.weight.sum()
        base = target.base["base_color"]
        truth, base = composite(base, target.truth)[counted], base[counted]
        painted = base + constants[:, None, 3:] * (constants[:, None, :3] - base)
        total += ((painted - truth).abs().mean(dim=-1) * weight).sum(dim=1)
    return total / len(targets)


def test_the_layers_of_exemplars_are_those_of_their_targets(tiny_exemplars: Exemplars, targets: list[Target]) -> None:
    assert torch.equal(constant_layers(tiny_exemplars, everywhere, CPU), best_constants(targets))


def test_further_maps_do_not_change_the_first(targets: list[Target]) -> None:
    """That of base_color, whose further channels are the mean of the true layers, weighted by alpha."""
    rough = torch.rand(32, 32, 1, generator=torch.Generator().manual_seed(0))
    whole = [
        Target(
            t.subject,
            Layer(torch.cat([t.truth.values, rough], -1), ("roughness",)),
            {**t.base, "roughness": 0 * rough},
            t.weight,
        )
        for t in targets
    ]
    constants = best_constants(whole)
    assert constants.shape == (2, 5)
    assert torch.equal(constants[0, :4], best_constants(targets)[0])
    laid = [t.weight / t.weight.sum() * t.truth.alpha for t in targets]
    mean = sum(float((weight * rough[..., 0]).sum()) for weight in laid) / sum(float(weight.sum()) for weight in laid)
    assert float(constants[0, 4]) == pytest.approx(mean, rel=1e-4)


def test_of_roughness_none_errs_less_over_paints_that_differ() -> None:
    rng = torch.Generator().manual_seed(1)
    truth = torch.rand(2, 8, 8, 5, generator=rng)
    truth[..., 3] *= 0.5
    bases = [{"base_color": torch.zeros(8, 8, 3), "roughness": torch.full((8, 8, 1), rough)} for rough in (0.2, 0.7)]
    targets = [Target(n, Layer(truth[n], ("roughness",)), bases[n], torch.ones(8, 8)) for n in range(2)]
    axis = torch.linspace(0, 1, 41)
    pairs = torch.cartesian_prod(axis, axis)  # roughness and alpha
    grid = torch.cat([torch.zeros(len(pairs), 3), pairs.flip(1)], dim=1)
    found, *others = (
        sum(float(target.errors(layer)[1]) for target in targets) for layer in (best_constants(targets)[1], *grid)
    )
    assert found <= min(others) * 1.002


def test_of_normals_it_is_the_best_single_direction() -> None:
    """Most of the surface is flat, and a third tilts to one side: the least mean angle is at the flat direction."""
    turn = math.radians(30.0)
    truth = torch.tensor([0.5, 0.5, 0.5, 1.0, 0.0, 0.0, 1.0]).repeat(9, 9, 1)
    truth[:3, :, 4:] = torch.tensor([math.sin(turn), 0.0, math.cos(turn)])
    base = {"base_color": torch.full((9, 9, 3), 0.5), "normal": torch.tensor([0.0, 0.0, 1.0]).expand(9, 9, 3)}
    target = Target(0, Layer(truth, ("normal",)), base, torch.ones(9, 9))
    assert float(target.errors(best_constants([target])[1])[1]) == pytest.approx(10.0, abs=0.1)
    target = replace(target, weight=torch.ones(9, 9) + 9 * (truth[..., 4] > 0))
    tilted = composite_maps(base, Layer(best_constants([target])[1], ("normal",)))["normal"][0, 0]
    assert math.degrees(math.atan2(float(tilted[0]), float(tilted[2]))) == pytest.approx(30.0, abs=0.2)
