"""Directions are drawn where the light is, with the density that `pdf` returns."""

import numpy as np
import pytest
import torch
from svbrdfgan_numpy.environment import EnvironmentEmitter, pixels_of, prepare_emitter

from svbrdfgan.testing import scenes
from svbrdfgan.types import Environment


def _spots(rotation: float) -> Environment:
    """A few bright pixels, at both poles and the seam too, in a dark sky that is not quite black."""
    radiance = torch.full((8, 16, 3), 0.05)
    radiance[0, 3], radiance[7, 9], radiance[4, 0], radiance[3, 15] = 3.0, 2.0, 5.0, 1.0
    return Environment(radiance, rotation)


def _uniform_directions(count: int) -> np.ndarray:
    direction = np.random.default_rng(1).normal(size=(count, 3))
    return direction / np.linalg.norm(direction, axis=1, keepdims=True)


def _luminance(light: EnvironmentEmitter, environment: Environment, direction: np.ndarray) -> np.ndarray:
    return light.taps(direction).apply(pixels_of(environment)).mean(axis=1)


@pytest.mark.parametrize("rotation", [0.0, 1.0])
def test_the_density_is_that_of_the_samples(rotation: float) -> None:
    light = prepare_emitter(_spots(rotation))
    drawn = light.sample(np.random.default_rng(2).random((200_000, 2)))
    uniform = _uniform_directions(200_000)
    assert np.allclose(np.linalg.norm(drawn, axis=1), 1.0)
    for axis in np.eye(3):  # the share drawn in each octant's slabs is the integral of the density there
        for low, high in ((-1.0, -0.4), (-0.4, 0.3), (0.3, 1.0)):
            share = ((drawn @ axis >= low) & (drawn @ axis < high)).mean()
            density = light.pdf(uniform) * ((uniform @ axis >= low) & (uniform @ axis < high))
            error = np.hypot(np.sqrt(share / 200_000), 4.0 * np.pi * density.std() / np.sqrt(200_000))
            assert abs(share - 4.0 * np.pi * density.mean()) < 5.0 * error


def test_the_light_of_all_directions_is_estimated_well() -> None:
    environment = _spots(0.3)
    light = prepare_emitter(environment)
    drawn = light.sample(np.random.default_rng(3).random((50_000, 2)))
    uniform = _uniform_directions(200_000)
    ratio = _luminance(light, environment, drawn) / light.pdf(drawn)
    flat = 4.0 * np.pi * _luminance(light, environment, uniform)
    assert abs(ratio.mean() - flat.mean()) < 5.0 * np.hypot(ratio.std() / 50_000**0.5, flat.std() / 200_000**0.5)
    assert ratio.std() < 0.1 * flat.std()


def test_no_light_is_missed() -> None:
    environment = scenes.sun(0, 0, rows=4, cols=8)
    light, direction = prepare_emitter(environment), _uniform_directions(20_000)
    lit = _luminance(light, environment, direction) > 0.0
    assert lit.any()
    assert np.array_equal(light.pdf(direction) > 0.0, lit)


def test_a_black_sky_is_drawn_uniformly() -> None:
    light = prepare_emitter(scenes.constant_light(0.0, rows=64, cols=128))
    assert np.allclose(light.pdf(_uniform_directions(100)), 1.0 / (4.0 * np.pi), rtol=0.02)


def test_a_single_pixel_and_extreme_random_numbers() -> None:
    light = prepare_emitter(scenes.constant_light(2.0, rows=1, cols=1))
    ends = np.array([[0.0, 0.0], [1.0 - 2**-53, 1.0 - 2**-53]])
    assert np.isfinite(light.sample(ends)).all()
    assert (light.pdf(light.sample(ends)) > 0.0).all()
