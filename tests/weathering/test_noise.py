"""The noise is what its docstrings say: bounded, of zero mean, smooth, seeded, and of the wavelengths asked for."""

import numpy as np
import pytest

from svbrdfgan.weathering.noise import fbm, gradient_noise

POINTS = np.random.default_rng(1).uniform(-40.0, 40.0, (40_000, 3))


@pytest.mark.parametrize("noise", [gradient_noise, fbm])
def test_is_bounded_and_of_zero_mean(noise):
    values = noise(POINTS, 3)
    assert np.abs(values).max() <= 1.0
    assert abs(values.mean()) < 5.0 * values.std() / np.sqrt(len(values))
    assert 0.1 < values.std() < 0.4


def test_is_zero_on_the_lattice_and_nowhere_near_constant_between():
    lattice = np.stack(np.meshgrid(*[np.arange(-3.0, 4.0)] * 3), axis=-1).reshape(-1, 3)
    assert np.array_equal(gradient_noise(lattice, 5), np.zeros(len(lattice)))
    assert gradient_noise(lattice + 0.5, 5).std() > 0.15


def test_has_continuous_first_and_second_derivatives_across_cells():
    step, line = 1e-4, np.linspace(0.9, 1.1, 2001)
    points = np.column_stack([line, np.full_like(line, 0.3), np.full_like(line, -0.4)])
    values = gradient_noise(points, 2)
    second = np.diff(values, 2) / step**2
    assert np.abs(np.diff(values)).max() < 4.0 * step
    assert np.abs(np.diff(second)).max() < 0.05 * np.ptp(second) + 1e-2


def test_same_seed_same_noise_and_other_seeds_independent():
    first = fbm(POINTS, 7)
    assert np.array_equal(first, fbm(POINTS, 7))
    others = [fbm(POINTS, seed) for seed in (0, 8, 2**31 - 1)]
    assert all(abs(np.corrcoef(first, other)[0, 1]) < 0.03 for other in others)


def test_does_not_repeat():
    assert (
        abs(np.corrcoef(gradient_noise(POINTS, 0), gradient_noise(POINTS + np.array([256.0, 0.0, 0.0]), 0))[0, 1])
        < 0.03
    )


def test_known_values_on_every_machine():
    points = np.array([[0.25, 0.5, 0.75], [-3.4, 17.1, 0.2]])
    assert np.allclose(gradient_noise(points, 11), [-0.09259069794964267, -0.10944373510580534], atol=1e-12)


def test_octaves_add_finer_and_weaker_waves():
    def roughness(octaves: int) -> float:
        near = fbm(POINTS + np.array([0.02, 0.0, 0.0]), 4, octaves=octaves) - fbm(POINTS, 4, octaves=octaves)
        return float(near.std() / fbm(POINTS, 4, octaves=octaves).std())

    one, two, three = (roughness(octaves) for octaves in (1, 2, 3))
    # Equal slopes add in quadrature: an octave of half the strength and twice the frequency has the slope of the first.
    assert two / one == pytest.approx(np.sqrt(2.0 / 1.25), rel=0.1)
    assert three / one == pytest.approx(np.sqrt(3.0 / 1.3125), rel=0.1)


def test_one_octave_is_gradient_noise_shifted():
    assert np.allclose(fbm(POINTS, 1, octaves=1), gradient_noise(POINTS + np.array([0.37, 0.71, 0.13]), 64))
