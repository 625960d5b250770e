"""Light indoors: as bright as skies, from above, and unlike them."""

from __future__ import annotations

import numpy as np
import pytest

from svbrdfgan.errors import ConfigError
from svbrdfgan.procedural.room import build_room
from svbrdfgan.procedural.sky import build_sky, sample_sky


def plane(radiance: np.ndarray) -> np.ndarray:
    """Radiance of a white plane that faces up, ring by ring."""
    rows, cols = radiance.shape[:2]
    edge = np.cos(np.linspace(0.0, np.pi, rows + 1))
    weight = (edge[:-1] - edge[1:]) * 2.0 * np.pi / cols * np.maximum((edge[:-1] + edge[1:]) / 2, 0.0)
    return np.einsum("rck,r->k", radiance, weight) / np.pi


@pytest.mark.parametrize("seed", range(8))
def test_a_room_is_as_bright_as_a_sky_and_lit_from_above(seed: int) -> None:
    room = build_room(seed).numpy().astype(float)
    assert room.shape == (64, 128, 3)
    assert room.min() >= 0.0
    assert plane(room).mean() == pytest.approx(1.0, rel=2e-3)
    brightest = np.unravel_index(room.sum(axis=-1).argmax(), room.shape[:2])[0]
    assert brightest < 64 / 3  # 30 degrees over the horizon
    assert room[40:].max() < 0.5


def test_rooms_are_more_coloured_than_skies_on_the_whole() -> None:
    """Red over blue, of a white plane: lamps are warmer."""
    rooms = [plane(build_room(seed).numpy()) for seed in range(24)]
    skies = [plane(build_sky(sample_sky(seed)).numpy()) for seed in range(24)]
    ratio = [np.median([red / blue for red, _, blue in each]) for each in (rooms, skies)]
    assert ratio[0] > 1.2 * ratio[1]


def test_each_seed_is_a_room_of_its_own() -> None:
    assert (build_room(3) == build_room(3)).all()
    assert (build_room(3) != build_room(4)).any()
    with pytest.raises(ConfigError, match="room seed is -1"):
        build_room(-1)
