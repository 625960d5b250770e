"""The score: one for the truth, zero for the best constant, and only over what pictures show."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.errors import AssetError
from svbrdfgan.metrics.constant_layer import best_constants
from svbrdfgan.metrics.recovered import Scorer, Target, make_targets, mean_error, mean_errors, near_poles
from svbrdfgan.networks.inputs import Inputs
from svbrdfgan.rendering.compositing import bare_maps, composite
from svbrdfgan.types import Layer

CPU = torch.device("cpu")


def everywhere(index: int) -> Tensor:
    return torch.ones(32, 32)


def left_half(index: int) -> Tensor:
    return (torch.arange(32) < 16).float().expand(32, 32)


def truth_of(exemplars: Exemplars) -> Tensor:
    """G0's layer of each subject."""
    layers = [exemplars.layers[exemplars.views_of(n)[0]] for n in range(len(exemplars.subjects))]
    assert all(layer is not None for layer in layers)
    return torch.stack([layer.values for layer in layers if layer is not None])


@pytest.fixture(scope="module")
def targets(tiny_exemplars: Exemplars) -> list[Target]:
    return make_targets(tiny_exemplars, everywhere, CPU)[0]


def test_the_truth_recovers_everything(tiny_exemplars: Exemplars, targets: list[Target]) -> None:
    scorer = Scorer.make(tiny_exemplars, everywhere, best_constants(targets), CPU)
    assert scorer.recovered_by(truth_of(tiny_exemplars)) == 1.0


def test_poles_lie_at_nose_and_tail_alone() -> None:
    position = torch.tensor([[0.0, 0.1, 1.0], [0.0, 0.0, -1.0], [0.0, 0.55, 1.0], [0.0, 0.6, 1.0], [0.4, 0.3, 0.0]])
    geometry = torch.cat([position, torch.zeros(5, 3)], dim=1).T.reshape(1, 6, 1, 5)
    assert near_poles(geometry).flatten().tolist() == [True, True, True, False, False]


def test_errors_away_from_the_poles_do_not_count_there(tiny_exemplars: Exemplars, targets: list[Target]) -> None:
    constants = best_constants(targets)
    scorer = Scorer.make(tiny_exemplars, everywhere, constants, CPU)
    ends, truth = scorer.at_poles(constants), truth_of(tiny_exemplars)
    assert ends is not None
    near = near_poles(scorer.inputs.geometry).unsqueeze(-1)
    assert ends.recovered_by(torch.where(near, truth, 0.0)) == 1.0
    assert ends.recovered_by(torch.where(near, constants[0], truth)) == pytest.approx(0.0, abs=1e-6)
    aside = torch.zeros_like(scorer.inputs.geometry) + torch.eye(6)[0].reshape(1, 6, 1, 1)
    everything_else = replace(scorer, inputs=Inputs(aside))
    assert everything_else.at_poles(constants) is None


def test_further_maps_are_judged_apart() -> None:
    """Half covered by alpha 1, half by alpha 0: an error of the map counts where it shows alone."""
    target = two_maps()
    made = target.truth.values.clone()
    made[..., 4] = 0.4
    torch.testing.assert_close(target.errors(made), torch.tensor([0.0, (1 * 0.5 + 3 * 0.3) / 5]))
    assert float(target.errors(made)[0]) == 0.0


def test_a_further_map_counts_where_it_can_be_observed() -> None:
    target = replace(two_maps(), observed={"roughness": torch.tensor([[0.0, 0.0], [3.0, 0.0]])})
    made = target.truth.values + 0.1 * torch.tensor([1.0, 0.0, 0.0, 0.0, 0.0])
    made[..., 4] = torch.tensor([[0.0, 0.0], [0.4, 0.0]])
    torch.testing.assert_close(target.errors(made)[1], torch.tensor(0.3))
    assert target.errors(made)[0] > 0, "base_color counts wherever it is seen"
    elsewhere = target.within(torch.tensor([[True, True], [False, False]]))
    assert elsewhere.errors(made)[1].isnan()


def test_a_map_that_is_observed_on_some_subjects_is_judged_there() -> None:
    blind = replace(two_maps(), observed={"roughness": torch.zeros(2, 2)})
    made = two_maps().truth.values.clone()
    made[..., 4] = 0.4
    found = mean_errors([two_maps(), blind], made.unsqueeze(0))
    assert found == pytest.approx([0.0, (1 * 0.5 + 3 * 0.3) / 5])
    assert math.isnan(mean_errors([blind], made.unsqueeze(0))[1])


def test_errors_of_normals_are_angles() -> None:
    """Half of a layer tilted by 20 degrees: the composite is between, and nearly halfway."""
    turn = math.radians(20.0)
    truth = torch.tensor([0.5, 0.5, 0.5, 1.0, 0.0, 0.0, 1.0])
    made = torch.tensor([0.5, 0.5, 0.5, 1.0, math.sin(turn), 0.0, math.cos(turn)])
    base = {"base_color": torch.full((2, 2, 3), 0.5), "normal": torch.tensor([0.0, 0.0, 1.0]).expand(2, 2, 3)}
    target = Target(0, Layer(truth.expand(2, 2, 7), ("normal",)), base, torch.ones(2, 2))
    assert target.errors(made)[1].item() == pytest.approx(20.0, abs=1e-4)
    made[3] = 0.5
    assert target.errors(made)[1].item() == pytest.approx(10.0, abs=1e-4)


@pytest.mark.parametrize("name", ["base_color", "roughness", "metallic", "normal"])
def test_each_map_is_all_for_the_truth_and_nothing_for_its_constant(name: str) -> None:
    targets = whole_materials()
    constants = best_constants(targets)
    scorer = scorer_of(targets, constants)
    place = targets[0].names.index(name)
    truth = torch.stack([target.truth.values for target in targets])
    assert scorer.each_recovered_by(truth)[name] == pytest.approx(1.0, abs=1e-5)
    assert scorer.each_recovered_by(constants[place].expand_as(truth))[name] == pytest.approx(0.0, abs=1e-6)
    assert scorer.score(truth) == pytest.approx(1.0, abs=1e-5)
    others = [row for row in range(4) if row != place]
    worse = [scorer.each_recovered_by(constants[row].expand_as(truth))[name] for row in others]
    assert all(value is not None and value <= 1e-4 for value in worse), "no other layer is a better baseline"


def test_a_map_without_differences_or_observations_has_no_score() -> None:
    targets = whole_materials()
    for target in targets:
        target.truth["metallic"][:] = 0.0
    blind = [replace(t, observed={"normal": torch.zeros(8, 8)}) for t in targets]
    scorer = scorer_of(blind, best_constants(targets))
    assert scorer.constant_errors["metallic"] < 1e-3
    found = scorer.each_recovered_by(torch.stack([target.truth.values for target in targets]))
    assert found == {"base_color": 1.0, "roughness": 1.0, "metallic": None, "normal": None}
    assert scorer.score(torch.stack([target.truth.values for target in targets])) == 1.0


def two_maps() -> Target:
    truth, base = torch.full((2, 2, 5), 0.5), torch.full((2, 2, 3), 0.2)
    truth[..., 3] = torch.tensor([[1.0, 0.0], [1.0, 0.0]])
    truth[..., 4] = torch.tensor([[0.9, 0.1], [0.7, 0.1]])
    bare = {"base_color": base, "roughness": base[..., :1]}
    return Target(0, Layer(truth, ("roughness",)), bare, torch.tensor([[1.0, 1.0], [3.0, 0.0]]))


def whole_materials() -> list[Target]:
    """Two subjects of random layers, over dielectric, flat paint of two roughnesses."""
    rng = torch.Generator().manual_seed(3)
    targets = []
    for subject, rough in enumerate((0.3, 0.6)):
        truth = torch.rand(8, 8, 9, generator=rng)
        truth[..., 6:8] = truth[..., 6:8] - 0.3
        base = {"base_color": torch.rand(3, generator=rng)}
        base |= bare_maps({"roughness": rough, "metallic": 0.0, "normal": 0.0})
        base = {name: values.expand(8, 8, -1) for name, values in base.items()}
        weight = torch.rand(8, 8, generator=rng)
        targets.append(Target(subject, Layer(truth, ("roughness", "metallic", "normal")), base, weight))
    return targets


def scorer_of(targets: list[Target], constants: Tensor) -> Scorer:
    size = (len(targets), *targets[0].weight.shape, -1)
    errors = {n: mean_errors(targets, constants[k].expand(size))[k] for k, n in enumerate(targets[0].names)}
    return Scorer(torch.zeros(len(targets), 6, 8, 8), targets, errors)


def test_the_constant_recovers_nothing_of_what_it_was_chosen_on(
    tiny_exemplars: Exemplars, targets: list[Target]
) -> None:
    constants = best_constants(targets)
    scorer = Scorer.make(tiny_exemplars, everywhere, constants, CPU)
    assert scorer.recovered_by(constants[0].expand(2, 32, 32, 4)) == 0.0


def test_half_the_error_recovers_half(tiny_exemplars: Exemplars, targets: list[Target]) -> None:
    """Layers that composite to halfway between the constant's albedo and the truth's: E is linear along the way."""
    constants = best_constants(targets)
    scorer = Scorer.make(tiny_exemplars, everywhere, constants, CPU)
    black = {"base_color": torch.zeros(32, 32, 3)}
    opaque = [replace(t, base=black, truth=Layer(_opaque(t, t.truth))) for t in scorer.targets]
    ends = torch.stack([_opaque(t, Layer(constants[0])) for t in scorer.targets[::3]])
    truths = torch.stack([t.truth.values for t in opaque[::3]])
    one_each = [replace(t, subject=n) for n, t in enumerate(opaque[::3])]
    whole, half = (mean_error(one_each, layers) for layers in (ends, (ends + truths) / 2))
    assert half == pytest.approx(whole / 2, rel=1e-5)


def _opaque(target: Target, layer: Layer) -> Tensor:
    albedo = composite(target.base["base_color"], layer)
    return torch.cat([albedo, torch.ones(*albedo.shape[:-1], 1)], dim=-1)


def test_errors_are_weighted_by_area() -> None:
    base, truth, layer = torch.zeros(1, 2, 3), Layer(torch.zeros(1, 2, 4)), torch.zeros(1, 2, 4)
    layer[0, 0] = torch.tensor([1.0, 1.0, 1.0, 1.0])
    target = Target(0, truth, {"base_color": base}, torch.tensor([[3.0, 1.0]]))
    assert float(target.errors(layer)[0]) == 0.75


def test_weights_are_the_area_of_seen_learnable_texels(tiny_exemplars: Exemplars) -> None:
    targets, share = make_targets(tiny_exemplars, left_half, CPU)
    whole, all_of_it = make_targets(tiny_exemplars, everywhere, CPU)
    assert all_of_it["base_color"] == pytest.approx(1.0)
    for target, full in zip(targets, whole, strict=True):
        subject = tiny_exemplars.subjects[target.subject]
        assert torch.equal(full.weight, subject.buffer.area * subject.learnable_texels)
        assert torch.equal(target.weight, full.weight * left_half(0))
    shares = [float(t.weight.sum() / w.weight.sum()) for t, w in zip(targets[::3], whole[::3], strict=True)]
    assert share["base_color"] == pytest.approx(sum(shares) / 2)
    assert 0 < share["base_color"] < 1


def test_what_is_not_seen_does_not_count(tiny_exemplars: Exemplars) -> None:
    targets, _ = make_targets(tiny_exemplars, left_half, CPU)
    scorer = Scorer.make(tiny_exemplars, left_half, best_constants(targets), CPU)
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
    assert share["base_color"] == pytest.approx(1.0)
    assert len(targets) == 6


def test_bases_wear_each_exemplars_paint(tiny_exemplars: Exemplars, targets: list[Target]) -> None:
    for scene, target in zip(tiny_exemplars.scenes, targets, strict=True):
        painted = target.base["base_color"][target.weight > 0]
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
    assert torch.equal(target.truth.values, first.truth.values)
    assert torch.equal(target.base["base_color"], first.base["base_color"])
    assert torch.equal(target.weight, first.weight)
    assert share["base_color"] == pytest.approx(float(target.weight.sum() / everywhere_weight(tiny_exemplars)))


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
    truth, scorer = truth_of(tiny_exemplars), Scorer.make(tiny_exemplars, everywhere, best_constants(targets), CPU)
    by_geometry = {subject.geometry.numpy().tobytes(): truth[n] for n, subject in enumerate(tiny_exemplars.subjects)}

    def knows(inputs: Inputs) -> Tensor:
        return torch.stack([by_geometry[one.numpy().tobytes()] for one in inputs.geometry])

    assert torch.equal(scorer.layers(knows, batch=1), truth)
    assert scorer.recovered_by(scorer.layers(knows)) == 1.0
    assert scorer.recovered_by(1 - scorer.layers(knows)) < 0.5


def test_picture_shows_learned_layers_above_the_truth(tiny_exemplars) -> None:
    targets, _ = make_targets(tiny_exemplars, lambda index: torch.ones(32, 32), torch.device("cpu"))
    subjects = len(tiny_exemplars.subjects)
    scorer = Scorer(Inputs(torch.zeros(subjects, 6, 32, 32)), targets, {"base_color": 1.0})
    picture = scorer.picture(torch.zeros(subjects, 32, 32, 4))
    assert picture.shape == (64, 32 * subjects, 3)
    assert picture[:32].std() < 1e-6, "transparent layers are plain grey"
    assert picture[32:].std() > 0, "the truth is not"
