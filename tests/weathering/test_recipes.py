"""What each recipe promises: range, monotony, seeds, substances, sizes in metres, and where its matter goes."""

import dataclasses
import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import torch

from svbrdfgan.errors import ConfigError
from svbrdfgan.weathering.layer import recipe_from_options
from svbrdfgan.weathering.recipes import RECIPES, ChippedPaint, Dust, Grime, RoadDirt, Rust
from svbrdfgan.weathering.substances import Substance
from svbrdfgan.weathering.survey import survey

KINDS = (RoadDirt, Dust, Rust, ChippedPaint, Grime)
EVERY_RECIPE = pytest.mark.parametrize("kind", KINDS)
ALL_RECIPES = pytest.mark.parametrize("kind", RECIPES.values(), ids=list(RECIPES))


@pytest.fixture(scope="module")
def site(vehicle, shapes):
    """Some 14,000 texels of a box-shaped vehicle of 4 m."""
    texels = shapes.texels_of(vehicle, 20)
    return survey(vehicle, texels.position.reshape(-1, 3), texels.normal.reshape(-1, 3), texel=0.03)


def _steps(start, end, step):
    return start + step * (np.arange(round((end - start) / step)) + 0.5)


def panel(site, z=(-0.6, 0.4), y=(0.3, 0.9), step=0.004):
    """A close-up of a flank of the site's vehicle, `step` metres to a texel, far from edges."""
    place = np.meshgrid(_steps(*z, step), _steps(*y, step))
    position = torch.from_numpy(np.stack([np.full_like(place[0], 0.8), place[1], place[0]], axis=-1).reshape(-1, 3))
    count = len(position)
    normal = torch.tensor([1.0, 0.0, 0.0]).expand(count, 3).double()
    plain = torch.ones(count, dtype=torch.float64)
    return replace(
        site,
        position=position / site.length,
        height=position[:, 1] / site.tall,
        normal=normal,
        visibility=plain,
        curvature=0.0 * plain,
        **dict.fromkeys(("convex", "crease", "border"), 0.12 * plain),
        substance=torch.zeros(count, dtype=torch.uint8),
        texel=step / site.length,
    )


def mean_over_seeds(kind, site, **options):
    """Alpha without the luck of one pattern."""
    return torch.stack([kind(seed=seed, **options).paint(site).alpha for seed in range(6)]).mean(dim=0)


@EVERY_RECIPE
def test_no_amount_is_exactly_no_alpha(kind, site):
    assert not kind(amount=0.0).paint(site).alpha.any()


@EVERY_RECIPE
def test_more_covers_no_less_anywhere_and_more_in_all(kind, site):
    alphas = [kind(amount=amount, seed=2).paint(site).alpha for amount in (0.0, 0.1, 0.3, 0.5, 0.8, 1.0)]
    for less, more in pairwise(alphas):
        assert (more >= less - 2e-3).all()
        assert more.mean() > less.mean()


@EVERY_RECIPE
def test_maps_stay_in_range_and_vary(kind, site):
    for seed, scale in ((0, 1.0), (9, 0.25), (2**31 - 1, 4.0)):
        coat = kind(amount=1.0, seed=seed, scale=scale).paint(site)
        for values in (coat.color, coat.alpha, coat.roughness, coat.metallic):
            assert values.dtype == torch.float32
            assert values.isfinite().all()
            assert values.min() >= 0.0
            assert values.max() <= 1.0
        assert coat.color.std(dim=0).min() > 0.001
        assert coat.alpha.std() > 0.05
        assert coat.height.isfinite().all()


@EVERY_RECIPE
def test_same_seed_same_layer_other_seed_other_layer(kind, site):
    first, again, other = (kind(amount=0.8, seed=seed).paint(site).rgba for seed in (4, 4, 5))
    assert torch.equal(first, again)
    assert (first[:, 3] - other[:, 3]).abs().mean() > 0.01


@EVERY_RECIPE
def test_texels_are_painted_one_by_one(kind, site):
    whole, some = kind(seed=1).paint(site).rgba, kind(seed=1).paint(site.at(slice(100, 300))).rgba
    assert torch.equal(whole[100:300], some)


@EVERY_RECIPE
def test_nothing_lies_on_what_is_not_named(kind, site):
    for substance in Substance:
        under = torch.full_like(site.substance, substance)
        alpha = kind(amount=1.0).paint(replace(site, substance=under)).alpha
        assert bool(alpha.any()) == (kind.settles_on.get(substance, 0.0) > 0.0)


@EVERY_RECIPE
def test_slopes_are_those_of_the_height(kind, site):
    """Along two axes, against central differences in metres over a tenth of a texel."""
    place, step = panel(site), 1e-4
    recipe, axes = kind(amount=1.0, seed=3), [torch.zeros_like(place.position) for _ in range(2)]
    axes[0][:, 1], axes[1][:, 2] = 1.0, 1.0
    _, slopes = recipe.paint_relief(place, *axes)
    for axis, slope in zip(axes, slopes, strict=True):
        ahead, back = (
            recipe.paint(replace(place, position=place.position + side * step / site.length * axis)).height.double()
            for side in (1, -1)
        )
        difference = (ahead - back) * site.length / (2.0 * step)
        assert slope.abs().max() > 0.0
        error = (slope.double() - difference).abs()
        assert error.mean() < 0.05 * difference.abs().mean() + 1e-3


@EVERY_RECIPE
def test_patterns_have_their_size_in_metres_not_in_vehicles(kind, site):
    """A vehicle twice as long of the same texels has the same pattern at the same metres."""
    near = panel(site)
    doubled = replace(near, position=near.position / 2.0, texel=near.texel / 2.0, length=2.0 * near.length)
    small, large = (kind(amount=0.8, seed=2).paint(each).alpha for each in (near, replace(doubled, axles=())))
    alone = kind(amount=0.8, seed=2).paint(replace(near, axles=())).alpha
    assert (alone - large).abs().max() < 1e-3
    assert small.shape == large.shape


@EVERY_RECIPE
def test_finer_texels_show_finer_detail(kind, site):
    """Neighbours 4 mm apart differ more where texels are that fine than where texels are 6 cm."""
    fine = panel(site)
    coarse = replace(fine, texel=0.06 / site.length)
    rough = [
        kind(amount=1.0, seed=1).paint(each).rgba.view(150, 250, 4).diff(dim=1).abs().mean() for each in (fine, coarse)
    ]
    assert rough[0] > 1.5 * rough[1]


def test_road_dirt_thins_upwards_and_is_thrown_behind_the_wheels(site):
    alpha, metres = mean_over_seeds(RoadDirt, site, amount=0.8), site.position * site.length
    flank = (site.normal[:, 0].abs() > 0.9) & (site.position[:, 0].abs() > 0.19)
    bands = [alpha[flank & (metres[:, 1] > low) & (metres[:, 1] < low + 0.2)].mean() for low in (0.3, 0.5, 0.7)]
    assert bands[0] > bands[1] + 0.03 > bands[2] + 0.06
    front = max(site.axles) * site.length
    low = flank & (metres[:, 1] > 0.3) & (metres[:, 1] < 0.6)
    behind, ahead = (low & ((metres[:, 2] - front - at).abs() < 0.15) for at in (-0.5, 0.45))
    thrown = alpha - mean_over_seeds(RoadDirt, site, amount=0.8, spray=0.0)
    assert thrown[behind].mean() > thrown[ahead].mean() + 0.1


def test_dust_lies_on_what_faces_up(site):
    alpha, up = mean_over_seeds(Dust, site, amount=0.8), site.normal[:, 1]
    seen, steep = site.visibility > 0.25, up.abs() < 0.1
    assert alpha[(up > 0.9) & seen].mean() > 2.0 * alpha[steep & seen].mean()
    assert alpha[steep & seen].mean() > alpha[(up < -0.9) & seen].mean()


def test_rust_begins_at_edges_and_low_down(site):
    place = panel(site)
    edge = replace(place, convex=torch.where(place.position[:, 2] > 0.0, 0.002, 0.12))
    plain, near = (mean_over_seeds(Rust, each, amount=0.6) for each in (place, edge))
    ahead = place.position[:, 2] > 0.0
    assert near[ahead].mean() > plain[ahead].mean() + 0.1
    assert torch.equal(near[~ahead], plain[~ahead])
    low = place.position[:, 1] * site.length < 0.4
    assert plain[low].mean() > 1.5 * plain[~low].mean()


def test_rust_runs_down_flanks_and_nowhere_on_roofs(site):
    place = panel(site)
    dry, wet = (mean_over_seeds(Rust, place, amount=1.0, bleed=bleed) for bleed in (0.0, 2.0))
    assert (wet >= dry - 1e-4).all()
    assert wet.mean() > dry.mean() + 0.01
    up = torch.tensor([0.0, 1.0, 0.0]).expand_as(place.normal).double()
    roof = [Rust(amount=0.8, bleed=bleed).paint(replace(place, normal=up)).alpha for bleed in (0.0, 2.0)]
    assert torch.equal(*roof)


def test_chips_wear_edges_to_steel_within_a_rim_of_primer(site):
    place = panel(site)
    distance = (place.position[:, 1] * site.length - 0.6).abs()
    coat = ChippedPaint(amount=1.0, seed=2, rust=0.0, scratches=0.0).paint(replace(place, convex=distance))
    assert coat.alpha[distance < 0.006].mean() > coat.alpha[distance > 0.1].mean() + 0.3
    steel, primer = (coat.alpha > 0.9) & (coat.metallic > 0.8), (coat.alpha > 0.9) & (coat.metallic < 0.1)
    assert min(int(steel.sum()), int(primer.sum())) > 100
    assert coat.roughness[steel].mean() < coat.roughness[primer].mean() - 0.1
    assert coat.height[steel].mean() < coat.height[primer].mean() < 0.0


def test_scratches_are_asked_for(site):
    place = panel(site, step=0.002)
    none, many = (mean_over_seeds(ChippedPaint, place, amount=0.8, scratches=given) for given in (0.0, 2.0))
    assert (many >= none - 1e-4).all()
    assert many.mean() > none.mean() + 1e-3


def test_grime_stays_in_creases_and_gaps(site):
    place = panel(site)
    distance = (place.position[:, 1] * site.length - 0.6).abs()
    for kind in ("crease", "border"):
        alpha = mean_over_seeds(Grime, replace(place, **{kind: distance}), amount=0.6)
        assert alpha[distance < 0.01].mean() > alpha[distance > 0.1].mean() + 0.2


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("mud", {}, "'mud' is unknown.*road-dirt, dust, rust"),
        ("rsut", {}, "did you mean 'rust'"),
        ("dust", {"amuont": 0.5}, "did you mean 'amount'"),
        ("dust", {"amount": 1.5}, "amount is 1.5; wanted a number between 0.0 and 1.0"),
        ("dust", {"amount": "0.5"}, "amount"),
        ("dust", {"amount": True}, "amount"),
        ("dust", {"amount": math.nan}, "amount"),
        ("rust", {"seed": 1.5}, "seed"),
        ("rust", {"seed": -1}, "seed is -1; wanted a whole number between 0 and 2147483647"),
        ("road-dirt", {"scale": 0.0}, "scale is 0.0; wanted a number between"),
    ],
)
def test_wrong_options_are_refused_with_a_sentence(name, options, message):
    with pytest.raises(ConfigError, match=message):
        recipe_from_options(name, options)


@pytest.mark.parametrize("amount", [2.0, -0.1, math.nan, True, "1"])
def test_recipes_made_directly_are_checked_too(amount):
    with pytest.raises(ConfigError, match="amount is"):
        RoadDirt(amount=amount)


@ALL_RECIPES
def test_every_option_is_taken_by_name(kind):
    name = next(name for name, made in RECIPES.items() if made is kind)
    options = {field.name: field.metadata["least"] for field in dataclasses.fields(kind)}
    assert recipe_from_options(name, options) == kind(**options)
