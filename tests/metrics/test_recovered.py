"""The score: one for the truth, zero for the best constant, and only over what pictures show."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.errors import AssetError
from svbrdfgan.metrics.recovered import Scorer, Target, best_constant, make_targets, mean_error, near_poles
from svbrdfgan.rendering.compositing import composite

CPU = torch.device("cpu")


def everywhere(index: int) -> Tensor:
    return torch.ones(32, 32)


def left_half(index: int) -> Tensor:
    return (torch.arange(32) < 16).float().expand(32, 32)


def truth_of(exemplars: Exemplars) -> Tensor:
    """G0's layer of each subject."""
    layers = [exemplars.layers[exemplars.views_of(n)[0]] for n in range(len(exemplars.subjects))]
    assert all(layer is not None for layer in layers)
    return torch.stack([layer for layer in layers if layer is not None])


@pytest.fixture(scope="module")
def targets(tiny_exemplars: Exemplars) -> list[Target]:
    return make_targets(tiny_exemplars, everywhere, CPU)[0]


def test_the_truth_recovers_everything(tiny_exemplars: Exemplars, targets: list[Target]) -> None:
    scorer = Scorer.make(tiny_exemplars, everywhere, best_constant(targets), CPU)
    assert scorer.recovered_by(truth_of(tiny_exemplars)) == 1.0


def test_poles_lie_at_nose_and_tail_alone() -> None:
    position = torch.tensor([[0.0, 0.1, 1.0], [0.0, 0.0, -1.0], [0.0, 0.55, 1.0], [0.0, 0.6, 1.0], [0.4, 0.3, 0.0]])
    geometry = torch.cat([position, torch.zeros(5, 3)], dim=1).T.reshape(1, 6, 1, 5)
    assert near_poles(geometry).flatten().tolist() == [True, True, True, False, False]


def test_errors_away_from_the_poles_do_not_count_there(tiny_exemplars: Exemplars, targets: list[Target]) -> None:
    constant = best_constant(targets)
    scorer = Scorer.make(tiny_exemplars, everywhere, constant, CPU)
    ends, truth = scorer.at_poles(constant), truth_of(tiny_exemplars)
    assert ends is not None
    near = near_poles(scorer.geometry).unsqueeze(-1)
    assert ends.recovered_by(torch.where(near, truth, 0.0)) == 1.0
    assert ends.recovered_by(torch.where(near, constant, truth)) == pytest.approx(0.0, abs=1e-6)
    everything_else = replace(scorer, geometry=torch.zeros_like(scorer.geometry) + torch.eye(6)[0].reshape(1, 6, 1, 1))
    assert everything_else.at_poles(constant) is None


def test_further_maps_are_judged_apart() -> None:
    """Half covered by alpha 1, half by alpha 0: an error of the map counts where it shows alone."""
    truth, base = torch.full((2, 2, 5), 0.5), torch.full((2, 2, 4), 0.2)
    truth[..., 3] = torch.tensor([[1.0, 0.0], [1.0, 0.0]])
    truth[..., 4] = torch.tensor([[0.9, 0.1], [0.7, 0.1]])
    target = Target(0, truth, base, torch.tensor([[1.0, 1.0], [3.0, 0.0]]), ("roughness",))
    made = truth.clone()
    made[..., 4] = 0.4
    torch.testing.assert_close(target.errors(made), torch.tensor([0.0, (1 * 0.5 + 3 * 0.3) / 5]))
    assert float(target.error(made)) == 0.0
    constant = best_constant([target])
    assert float(constant[4]) == pytest.approx((1 * 0.9 + 3 * 0.7) / 4)
    plain = Target(0, truth[..., :4], base[..., :3], target.weight)
    assert torch.equal(constant[:4], best_constant([plain]))


def test_the_constant_recovers_nothing_of_what_it_was_chosen_on(
    tiny_exemplars: Exemplars, targets: list[Target]
) -> None:
    constant = best_constant(targets)
    scorer = Scorer.make(tiny_exemplars, everywhere, constant, CPU)
    assert scorer.recovered_by(constant.expand(2, 32, 32, 4)) == 0.0


def test_half_the_error_recovers_half(tiny_exemplars: Exemplars, targets: list[Target]) -> None:
    """Layers that composite to halfway between the constant's albedo and the truth's: E is linear along the way."""
    constant = best_constant(targets)
    scorer = Scorer.make(tiny_exemplars, everywhere, constant, CPU)
    opaque = [
        replace(t, base=torch.zeros_like(t.base), truth=_opaque(composite(t.base, t.truth))) for t in scorer.targets
    ]
    ends = [torch.stack([_opaque(composite(t.base, layer)) for t in scorer.targets[::3]]) for layer in (constant,)]
    truths = torch.stack([t.truth for t in opaque[::3]])
    one_each = [replace(t, subject=n) for n, t in enumerate(opaque[::3])]
    whole, half = (mean_error(one_each, layers) for layers in (ends[0], (ends[0] + truths) / 2))
    assert half == pytest.approx(whole / 2, rel=1e-5)


def _opaque(albedo: Tensor) -> Tensor:
    return torch.cat([albedo, torch.ones(*albedo.shape[:-1], 1)], dim=-1)


def test_the_constant_is_the_best(targets: list[Target]) -> None:
    """No grid point, and nothing in its neighbourhood, does better."""
    constant, rng = best_constant(targets), torch.Generator().manual_seed(0)
    found = _errors(targets, constant[None])[0]
    axis = torch.linspace(0, 1, 7)
    grid = torch.cartesian_prod(axis, axis, axis, axis)
    near = [constant + scale * torch.randn(200, 4, generator=rng) for scale in (0.3, 0.05, 0.01)]
    others = _errors(targets, torch.cat([grid, *near]).clamp(0, 1))
    assert found <= others.min() * 1.002


def test_a_constant_truth_is_found() -> None:
    layer = torch.tensor([0.3, 0.25, 0.2, 0.6])
    target = Target(0, layer.expand(8, 8, 4), torch.rand(8, 8, 3), torch.ones(8, 8))
    assert float(target.error(best_constant([target]))) < 2e-3


def _errors(targets: list[Target], constants: Tensor) -> Tensor:
    """E of each constant, from its definition."""
    total = torch.zeros(len(constants))
    for target in targets:
        counted = target.weight > 0
        weight = target.weight[counted] / target.weight.sum()
        truth, base = composite(target.base, target.truth)[counted], target.base[counted]
        painted = base + constants[:, None, 3:] * (constants[:, None, :3] - base)
        total += ((painted - truth).abs().mean(dim=-1) * weight).sum(dim=1)
    return total / len(targets)


def test_errors_are_weighted_by_area() -> None:
    base, truth, layer = torch.zeros(1, 2, 3), torch.zeros(1, 2, 4), torch.zeros(1, 2, 4)
    layer[0, 0] = torch.tensor([1.0, 1.0, 1.0, 1.0])
    target = Target(0, truth, base, torch.tensor([[3.0, 1.0]]))
    assert float(target.error(layer)) == 0.75


def test_weights_are_the_area_of_seen_learnable_texels(tiny_exemplars: Exemplars) -> None:
    targets, share = make_targets(tiny_exemplars, left_half, CPU)
    whole, all_of_it = make_targets(tiny_exemplars, everywhere, CPU)
    assert all_of_it == pytest.approx(1.0)
    for target, full in zip(targets, whole, strict=True):
        subject = tiny_exemplars.subjects[target.subject]
        assert torch.equal(full.weight, subject.buffer.area * subject.learnable_texels)
        assert torch.equal(target.weight, full.weight * left_half(0))
    shares = [float(t.weight.sum() / w.weight.sum()) for t, w in zip(targets[::3], whole[::3], strict=True)]
    assert share == pytest.approx(sum(shares) / 2)
    assert 0 < share < 1


def test_what_is_not_seen_does_not_count(tiny_exemplars: Exemplars) -> None:
    targets, _ = make_targets(tiny_exemplars, left_half, CPU)
    scorer = Scorer.make(tiny_exemplars, left_half, best_constant(targets), CPU)
    layers = truth_of(tiny_exemplars).clone()
    layers[:, :, 16:] = torch.rand(2, 32, 16, 4)
    assert scorer.recovered_by(layers) == 1.0
    layers[:, :, :16] = torch.rand(2, 32, 16, 4)
    assert scorer.recovered_by(layers) < 1.0


def test_a_texel_that_any_view_shows_counts(tiny_exemplars: Exemplars) -> None:
    def by_view(index: int) -> Tensor:
        seen = torch.zeros(32, 32)
        seen[:, index % 3 :: 3] = 1.0
        return seen

    targets, share = make_targets(tiny_exemplars, by_view, CPU)
    assert share == pytest.approx(1.0)
    assert len(targets) == 6


def test_bases_wear_each_exemplars_paint(tiny_exemplars: Exemplars, targets: list[Target]) -> None:
    for scene, target in zip(tiny_exemplars.scenes, targets, strict=True):
        painted = target.base[target.weight > 0]
        torch.testing.assert_close(painted, torch.tensor(scene.materials["body"]).expand_as(painted))


def test_a_limit_takes_targets_evenly(tiny_exemplars: Exemplars) -> None:
    few, _ = make_targets(tiny_exemplars, everywhere, CPU, limit=2)
    assert [target.subject for target in few] == [0, 1]


def test_of_subjects_that_are_not_chosen_nothing_is_asked(tiny_exemplars: Exemplars) -> None:
    asked: list[int] = []

    def seen(index: int) -> Tensor:
        asked.append(index)
        return left_half(index)

    (target,), share = make_targets(tiny_exemplars, seen, CPU, limit=1)
    assert asked == tiny_exemplars.views_of(0)
    (first, *_), _ = make_targets(tiny_exemplars, left_half, CPU)
    for name in ("truth", "base", "weight"):
        assert torch.equal(getattr(target, name), getattr(first, name))
    assert share == pytest.approx(float(target.weight.sum() / everywhere_weight(tiny_exemplars)))


def everywhere_weight(exemplars: Exemplars) -> float:
    """The first subject's learnable area."""
    return float((exemplars.subjects[0].buffer.area * exemplars.subjects[0].learnable_texels).sum())


def test_nothing_weathered_or_seen_is_told(tiny_exemplars: Exemplars) -> None:
    unknown = tuple(scene.model_copy(update={"weathering": "unknown"}) for scene in tiny_exemplars.scenes)
    with pytest.raises(AssetError, match="nothing can be scored"):
        make_targets(replace(tiny_exemplars, scenes=unknown), everywhere, CPU)
    with pytest.raises(AssetError, match="nothing can be scored"):
        make_targets(tiny_exemplars, lambda index: torch.zeros(32, 32), CPU)


def test_a_generator_is_scored_by_what_it_paints(tiny_exemplars: Exemplars, targets: list[Target]) -> None:
    truth, scorer = truth_of(tiny_exemplars), Scorer.make(tiny_exemplars, everywhere, best_constant(targets), CPU)
    by_geometry = {subject.geometry.numpy().tobytes(): truth[n] for n, subject in enumerate(tiny_exemplars.subjects)}

    def knows(geometry: Tensor) -> Tensor:
        return torch.stack([by_geometry[one.numpy().tobytes()] for one in geometry])

    assert torch.equal(scorer.layers(knows, batch=1), truth)
    assert scorer.recovered(knows) == 1.0
    assert scorer.recovered(lambda geometry: 1 - knows(geometry)) < 0.5


def test_picture_shows_learned_layers_above_the_truth(tiny_exemplars) -> None:
    targets, _ = make_targets(tiny_exemplars, lambda index: torch.ones(32, 32), torch.device("cpu"))
    subjects = len(tiny_exemplars.subjects)
    scorer = Scorer(torch.zeros(subjects, 6, 32, 32), targets, 1.0, 1.0)
    picture = scorer.picture(torch.zeros(subjects, 32, 32, 4))
    assert picture.shape == (64, 32 * subjects, 3)
    assert picture[:32].std() < 1e-6, "transparent layers are plain grey"
    assert picture[32:].std() > 0, "the truth is not"
