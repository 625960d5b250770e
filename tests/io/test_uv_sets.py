"""KHR_texture_transform, by what it does to single points."""

import math

import numpy as np
import pytest

from svbrdfgan.io.uv_sets import UVSet

SOME = np.random.default_rng(3).uniform(-1, 2, (20, 2))


def test_without_a_transform_nothing_moves() -> None:
    np.testing.assert_allclose(UVSet.of({"index": 0}).moved(SOME), SOME, atol=1e-12)


@pytest.mark.parametrize(("degrees", "expected"), [(90, (0.0, 2.0)), (180, (-1.0, 1.0)), (-90, (0.0, 0.0))])
def test_it_turns_counter_clockwise_about_the_upper_left_corner(degrees: float, expected: tuple[float, float]) -> None:
    """The upper right corner goes up, as the extension says of UVs (the picture turns clockwise)."""
    turned = UVSet(rotation=math.radians(degrees)).moved(np.array([[1.0, 1.0], [0.0, 1.0]]))
    np.testing.assert_allclose(turned, [expected, (0.0, 1.0)], atol=1e-12)


def test_scale_comes_before_rotation_and_offset_last() -> None:
    """Against the product of matrices, in glTF's coordinates, of which v points down."""
    info = {"extensions": {"KHR_texture_transform": {"offset": [0.1, 0.7], "rotation": 0.4, "scale": [2, 3]}}}
    sine, cosine = math.sin(0.4), math.cos(0.4)
    turn, scale = np.array([[cosine, sine], [-sine, cosine]]), np.diag([2.0, 3.0])
    down = SOME * [1, -1] + [0, 1]
    expected = down @ (turn @ scale).T + [0.1, 0.7]
    np.testing.assert_allclose(UVSet.of(info).moved(SOME) * [1, -1] + [0, 1], expected, atol=1e-12)
