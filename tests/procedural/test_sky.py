"""Procedural skies: how much light they give, from where, and of what colour."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan.errors import ConfigError
from svbrdfgan.procedural.sky import SkyParameters, build_sky, sample_sky

ELEVATIONS = [2.0, 15.0, 45.0, 88.0]


def _weights(rows: int, cols: int) -> tuple[Float[ndarray, " rows"], Float[ndarray, " rows"]]:
    """Solid angle of a row's pixels, and the cosine of its polar angle."""
    edge = np.cos(np.linspace(0.0, np.pi, rows + 1))
    return (edge[:-1] - edge[1:]) * 2.0 * np.pi / cols, np.cos((np.arange(rows) + 0.5) / rows * np.pi)


def _plane(sky: Float[ndarray, "rows cols 3"]) -> Float[ndarray, " 3"]:
    solid_angle, cosine = _weights(*sky.shape[:2])
    return np.einsum("rck,r->k", sky, solid_angle * np.maximum(cosine, 0.0)) / np.pi


@pytest.mark.parametrize("elevation", ELEVATIONS)
@pytest.mark.parametrize("cover", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("rows", [16, 64])
def test_white_plane_has_radiance_one(elevation: float, cover: float, rows: int) -> None:
    sky = build_sky(SkyParameters(math.radians(elevation), cloud_cover=cover), rows, 2 * rows).numpy().astype(float)
    assert _plane(sky).mean() == pytest.approx(1.0, rel=1e-5)
    assert np.isfinite(sky).all()
    assert sky.min() >= 0.0


@pytest.mark.parametrize(("rows", "cols"), [(400, 16), (512, 16), (16, 400)])
def test_narrow_images_hold_the_sun_too(rows: int, cols: int) -> None:
    """Their pixels may lie many widths of the sun's disc away from its middle."""
    sky = build_sky(SkyParameters(0.5), rows, cols).numpy().astype(float)
    assert _plane(sky).mean() == pytest.approx(1.0, rel=1e-5)
    assert sky.max() > 20.0


@pytest.mark.parametrize(("azimuth", "column"), [(0.0, 0.0), (math.pi / 2, 0.75), (math.pi, 0.5), (-math.pi / 2, 0.25)])
def test_sun_stands_where_the_conventions_say(azimuth: float, column: float) -> None:
    """Azimuth 0 is +Z, the seam; +X is at u = 0.75, -Z in the middle."""
    rows, cols = 64, 128
    sky = build_sky(SkyParameters(math.radians(45.0), azimuth), rows, cols).sum(dim=-1).numpy()
    row, col = np.unravel_index(sky.argmax(), sky.shape)
    assert abs((row + 0.5) / rows - 0.25) <= 1.0 / rows
    away = abs((col + 0.5) / cols - column)
    assert min(away, 1.0 - away) <= 1.0 / cols


def test_sun_direction_is_that_of_an_orbiting_camera() -> None:
    x, y, z = SkyParameters(math.radians(30.0), math.radians(90.0)).sun_direction
    assert (x, y, z) == pytest.approx((math.cos(math.radians(30.0)), 0.5, 0.0))


def test_sun_keeps_its_energy_at_any_size() -> None:
    """Radiance near the sun, over solid angle, relative to the whole sky, is the same for every image size."""
    shares = []
    for rows in (16, 32, 128):
        sky = build_sky(SkyParameters(math.radians(50.0)), rows, 2 * rows).numpy().astype(float)
        solid_angle, cosine = _weights(rows, 2 * rows)
        light = sky.mean(axis=-1) * (solid_angle * np.maximum(cosine, 0.0))[:, None]
        shares.append(light[sky.mean(axis=-1) > 5.0].sum() / light.sum())
    np.testing.assert_allclose(shares, shares[-1], rtol=0.05)
    assert 0.6 < shares[-1] < 0.95  # the direct share of clear daylight


def test_low_sun_is_warm_and_clear_sky_is_blue() -> None:
    low, high = (build_sky(SkyParameters(math.radians(e))).numpy() for e in (4.0, 60.0))
    ratios = []
    for sky in (low, high):
        red, _, blue = sky[np.unravel_index(sky.sum(-1).argmax(), sky.shape[:2])]
        ratios.append(red / blue)
    assert ratios[0] > 2.0 > ratios[1] > 0.9
    away_from_sun = high[12:24, 64]
    assert (away_from_sun[:, 2] > 1.3 * away_from_sun[:, 0]).all()


def test_overcast_sky_is_brightest_at_the_zenith_and_has_no_shadows() -> None:
    """CIE overcast sky: the zenith has three times the horizon's luminance."""
    sky = build_sky(SkyParameters(math.radians(40.0), cloud_cover=1.0)).numpy()[:, 10].mean(axis=-1)
    _, height = _weights(64, 128)
    np.testing.assert_allclose(sky[:31] / sky[0], (1.0 + 2.0 * height[:31]) / (1.0 + 2.0 * height[0]), rtol=0.02)
    assert build_sky(SkyParameters(math.radians(40.0), cloud_cover=1.0)).max() < 10.0
    assert build_sky(SkyParameters(math.radians(40.0))).max() > 100.0


def test_ground_reflects_what_it_receives() -> None:
    ground = (0.1, 0.2, 0.3)
    sky = build_sky(SkyParameters(0.7, ground=ground)).numpy()
    np.testing.assert_allclose(sky[-1, 0], np.array(ground) * _plane(sky.astype(float)), rtol=0.03)
    assert np.ptp(sky[40:], axis=(0, 1)).max() < 1e-6


def test_exposure_scales_the_light() -> None:
    one, three = (build_sky(SkyParameters(0.7, exposure=e)).numpy() for e in (1.0, 3.0))
    np.testing.assert_allclose(three, 3.0 * one, rtol=1e-5)


def test_seeds_make_skies() -> None:
    assert sample_sky(4) == sample_sky(4)
    np.testing.assert_array_equal(build_sky(sample_sky(4)), build_sky(sample_sky(4)))
    skies = [sample_sky(seed) for seed in range(60)]
    assert min(s.cloud_cover for s in skies) < 0.1 < 0.9 < max(s.cloud_cover for s in skies)
    assert math.degrees(min(s.sun_elevation for s in skies)) < 10.0
    assert math.degrees(max(s.sun_elevation for s in skies)) > 60.0


def test_impossible_skies_are_refused() -> None:
    changes: list[dict[str, Any]] = [
        {"sun_elevation": -0.1},
        {"turbidity": 1.0},
        {"cloud_cover": 1.5},
        {"ground": (0.1, 0.1, 2.0)},
    ]
    for change in changes:
        with pytest.raises(ConfigError, match="wanted"):
            replace(SkyParameters(0.5), **change)
    with pytest.raises(ConfigError, match="pixels"):
        build_sky(SkyParameters(0.5), rows=2)
    with pytest.raises(ConfigError, match="seed"):
        sample_sky(-3)
