"""What each smooth recipe promises: range, monotony, seeds, and where its matter goes."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import spearmanr

from svbrdfgan.weathering.recipes.smooth import SmoothChips, SmoothDirt, SmoothDust, SmoothRust
from svbrdfgan.weathering.survey import survey

EVERY_RECIPE = pytest.mark.parametrize("kind", [SmoothDirt, SmoothDust, SmoothRust, SmoothChips])


@pytest.fixture(scope="module")
def site(vehicle, texels, arrays):
    """The fields of a site, in NumPy, and the site itself as `whole`."""
    found = survey(vehicle, texels.position.reshape(-1, 3), texels.normal.reshape(-1, 3))
    return SimpleNamespace(whole=found, **vars(arrays(found)))


def painted(recipe, site):
    coat = recipe.paint(site.whole)
    return SimpleNamespace(**{name: value.numpy() for name, value in vars(coat).items()}, rgba=coat.rgba.numpy())


def mean_over_seeds(kind, site, **options):
    """Alpha without the luck of one pattern."""
    return np.mean([painted(kind(seed=seed, **options), site).alpha for seed in range(8)], axis=0)


@EVERY_RECIPE
def test_no_amount_is_exactly_no_alpha(kind, site):
    assert not painted(kind(amount=0.0), site).alpha.any()


@EVERY_RECIPE
def test_more_covers_no_less_anywhere_and_more_in_all(kind, site):
    alphas = [painted(kind(amount=amount, seed=2), site).alpha for amount in (0.0, 0.1, 0.3, 0.5, 0.8, 1.0)]
    assert all((more >= less).all() and more.mean() > less.mean() for less, more in pairwise(alphas))


@EVERY_RECIPE
def test_colour_and_alpha_stay_in_range_and_vary(kind, site):
    for seed, scale in ((0, 1.0), (9, 0.25), (2**31 - 1, 4.0)):
        layer = painted(kind(amount=1.0, seed=seed, scale=scale), site).rgba
        assert np.isfinite(layer).all()
        assert layer.min() >= 0.0
        assert layer.max() <= 1.0
        assert layer.std(axis=0).min() > 0.01
        assert layer[:, 3].std() > 0.15


@EVERY_RECIPE
def test_at_full_amount_much_is_covered_and_much_is_left(kind, site):
    alpha = mean_over_seeds(kind, site, amount=1.0)
    body = (site.height > 0.25) & (site.normal[:, 1] > -0.5) & (site.visibility > 0.25)
    assert 0.2 < alpha[body].mean() < 0.6


@EVERY_RECIPE
def test_same_seed_same_layer_other_seed_other_layer(kind, site):
    first, again, other = (painted(kind(amount=0.8, seed=seed), site).rgba for seed in (4, 4, 5))
    assert np.array_equal(first, again)
    assert np.abs(first[:, 3] - other[:, 3]).mean() > 0.03


@EVERY_RECIPE
def test_colours_are_earth_red_over_green_over_blue(kind, site):
    color = painted(kind(amount=1.0), site).color
    assert (np.diff(color, axis=1) < 0.0).all()


@EVERY_RECIPE
def test_detail_sharpens_and_moves_little(kind, site):
    """More texels are nearly clear or nearly covered, about as much is covered, and the other maps stay in range."""
    sharp = [painted(kind(amount=0.8, seed=seed, detail=1.0), site) for seed in range(3)]
    smooth = [painted(kind(amount=0.8, seed=seed, detail=0.0), site) for seed in range(3)]
    means = [np.mean([coat.alpha for coat in coats]) for coats in (smooth, sharp)]
    assert abs(means[1] - means[0]) < 0.15
    if kind is not SmoothDust:  # a film has no edges
        between = [np.mean([(coat.alpha > 0.1) & (coat.alpha < 0.7) for coat in coats]) for coats in (smooth, sharp)]
        assert between[1] < 0.8 * between[0]
    for coat in sharp:
        assert 0.2 < coat.roughness.min() <= coat.roughness.max() <= 1.0
        assert 0.0 <= coat.metallic.min() <= coat.metallic.max() <= 1.0


def test_bare_steel_is_smoother_than_rust_and_metallic(site):
    for recipe in (SmoothRust(amount=0.9, seed=2, detail=1.0), SmoothChips(amount=0.9, seed=2)):
        coat = painted(recipe, site)
        steel, rest = (coat.alpha > 0.3) & (coat.metallic > 0.7), (coat.alpha > 0.3) & (coat.metallic < 0.1)
        assert steel.sum() > 5
        assert coat.roughness[steel].mean() < coat.roughness[rest].mean() - 0.1


def test_road_dirt_falls_with_height(site):
    alpha = mean_over_seeds(SmoothDirt, site, amount=0.8)
    assert spearmanr(alpha, site.height).statistic < -0.7


def test_road_dirt_is_thrown_behind_the_wheels(site):
    front = max(site.axles)
    flank = (np.abs(site.normal[:, 0]) > 0.9) & (site.height > 0.3) & (site.height < 0.6)
    behind = flank & (np.abs(site.position[:, 2] - (front - 0.08)) < 0.04)
    ahead = flank & (np.abs(site.position[:, 2] - (front + 0.12)) < 0.04)
    spray, none = (mean_over_seeds(SmoothDirt, site, amount=0.7, spray=spray) for spray in (1.0, 0.0))
    thrown = spray - none
    assert thrown.min() >= -0.2
    assert thrown[behind].mean() > thrown[ahead].mean() + 0.1


def test_dust_lies_on_what_faces_up(site):
    alpha, up = mean_over_seeds(SmoothDust, site, amount=0.8), site.normal[:, 1]
    seen = site.visibility > 0.25
    assert alpha[(up > 0.9) & seen].mean() > 2.0 * alpha[(np.abs(up) < 0.1) & seen].mean()
    assert alpha[(np.abs(up) < 0.1) & seen].mean() > alpha[up < -0.9].mean()


def test_rust_prefers_shelter_and_edges(site):
    alpha = mean_over_seeds(SmoothRust, site, amount=0.7)
    plain = (site.visibility > 0.9) & (np.abs(site.curvature) < 0.1)
    assert alpha[(site.visibility > 0.9) & (site.curvature > 0.4)].mean() > 1.2 * alpha[plain].mean()
    assert alpha[site.visibility < 0.5].mean() > 1.2 * alpha[plain].mean()


def test_rust_bleeds_downward(site):
    """Flanks get runs on top of their blotches; the roof, where nothing can run, gets none."""
    flank, flat = np.abs(site.normal[:, 0]) > 0.9, np.abs(site.normal[:, 1]) > 0.9
    for seed in range(3):
        dry, wet = (painted(SmoothRust(amount=0.7, seed=seed, bleed=bleed), site).alpha for bleed in (0.0, 1.5))
        assert (wet >= dry).all()
        assert wet[flank].mean() > dry[flank].mean() + 0.01
        assert np.array_equal(wet[flat], dry[flat])
