"""Regions of glass, lights and trim on a body: functions that are negative inside, on positions before `bowed`."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan.procedural.outline import Outline

Region = Callable[[Float[ndarray, "vertices 3"]], Float[ndarray, " vertices"]]

_PILLAR = 0.009  # half-width of the pillars between side windows
_FRAME = 0.016  # distance from a side window's upper edge to the roof
_POST = 0.028  # distance from a windscreen's side to the edge of the cabin


def pillar_stations(outline: Outline) -> Float[ndarray, " stations"]:
    """z of the cross-sections in and beside the pillars: without vertices there, a cut would miss the pillars."""
    return np.array([z + side for z in _pillars(outline) for side in (-2.0 * _PILLAR, 0.0, 2.0 * _PILLAR)])


def _cabin(outline: Outline) -> tuple[float, float]:
    """z of the front and the rear end of the side windows, at mid height."""
    corners, shape = outline.landmarks, outline.shape
    front = 0.5 * (corners[4, 0] + corners[5, 0])
    rear = 0.5 * (corners[2, 0] + corners[3, 0])
    return front, front - shape.glazing * (front - rear)


def _pillars(outline: Outline) -> list[float]:
    """z of the pillars that divide the side windows."""
    front, rear = _cabin(outline)
    doors = min(max(1, round((front - rear) / 0.23)), 3)
    return [front + (rear - front) * k / doors for k in range(1, doors)]


def side_windows(outline: Outline) -> Region:
    """The windows on both sides, without the pillars between them."""
    _, rear = _cabin(outline)
    crown = 0.04 * outline.shape.width

    def distance(p: Float[ndarray, "vertices 3"]) -> Float[ndarray, " vertices"]:
        z, y = p[:, 2], p[:, 1]
        roof = np.minimum(outline.top(z + 0.016), outline.top(z - 0.016)) - crown - _FRAME
        inside = np.maximum(outline.belt(z) + 0.014 - y, y - roof)
        posts = [_PILLAR - np.abs(z - pillar) for pillar in _pillars(outline)]
        cargo = rear + _PILLAR - z if outline.shape.glazing < 0.98 else np.full_like(z, -1.0)
        return np.max([inside, cargo, *posts], axis=0)

    return distance


def windscreen(outline: Outline) -> Region:
    """The front glass, from the cowl to the roof."""
    corners = outline.landmarks
    low, start = corners[5, 1] + 0.012, corners[4, 0] + 0.010

    def distance(p: Float[ndarray, "vertices 3"]) -> Float[ndarray, " vertices"]:
        return np.max([_post(outline, p), low - p[:, 1] - 0.4 * p[:, 0] ** 2, start - p[:, 2]], axis=0)

    return distance


def rear_window(outline: Outline) -> Region:
    """The rear glass, from the deck or the belt to the roof."""
    corners = outline.landmarks
    low, high, start = corners[2, 1] + 0.010, corners[3, 1] - 0.016, corners[3, 0] + 0.004

    def distance(p: Float[ndarray, "vertices 3"]) -> Float[ndarray, " vertices"]:
        return np.max([_post(outline, p), low - p[:, 1], p[:, 1] - high, p[:, 2] - start], axis=0)

    return distance


def _post(outline: Outline, p: Float[ndarray, "vertices 3"]) -> Float[ndarray, " vertices"]:
    """Negative further than `_POST` from the cabin's side: keeps front and rear glass off the corner pillars."""
    return np.abs(p[:, 0]) - outline.half_width(p[:, 2], p[:, 1]) + _POST


def headlights(outline: Outline) -> Region:
    """Two lamps at the nose's corners."""
    nose, bumper = outline.landmarks[6, 1], outline.landmarks[7, 1]
    return _lamps(outline, 0.74, 0.5 * (nose + bumper) + 0.010, (outline.shape.lamps, 0.36 * (nose - bumper)), 1.0)


def tail_lights(outline: Outline) -> Region:
    """Two lamps at the tail's corners."""
    deck, bumper = outline.landmarks[1, 1], outline.landmarks[0, 1]
    return _lamps(outline, 0.90, 0.5 * (deck + bumper) + 0.006, (outline.shape.lamps, 0.44 * (deck - bumper)), -1.0)


def _lamps(outline: Outline, across: float, height: float, size: tuple[float, float], end: float) -> Region:
    half = 0.5 * outline.shape.width * (1.0 - outline.shape.taper)
    wide, tall = size[0] * half, max(size[1], 0.014)

    def distance(p: Float[ndarray, "vertices 3"]) -> Float[ndarray, " vertices"]:
        u, v = (np.abs(p[:, 0]) - across * half) / wide, (p[:, 1] - height) / tall
        ellipse = ((np.abs(u) ** 3 + np.abs(v) ** 3) ** (1.0 / 3.0) - 1.0) * min(wide, tall)
        return np.maximum(ellipse, 0.44 - end * p[:, 2])

    return distance


def grille(outline: Outline) -> Region:
    """The air intake in the front bumper."""
    s, bumper = outline.shape, outline.landmarks[7, 1]
    height, tall = s.clearance + 0.52 * (bumper - s.clearance), 0.30 * (bumper - s.clearance)

    def distance(p: Float[ndarray, "vertices 3"]) -> Float[ndarray, " vertices"]:
        u, v = p[:, 0] / (0.30 * s.width), (p[:, 1] - height) / tall
        ellipse = ((u**4 + v**4) ** 0.25 - 1.0) * tall
        return np.maximum(ellipse, 0.44 - p[:, 2])

    return distance


def cladding(outline: Outline) -> Region:
    """The unpainted band along the sills and around the arches."""
    s = outline.shape

    def distance(p: Float[ndarray, "vertices 3"]) -> Float[ndarray, " vertices"]:
        y, z = p[:, 1], p[:, 2]
        band = y - outline.floor(z) - max(s.cladding, 0.012)
        arches = [np.hypot(z - axle, y - s.wheel_radius) - outline.arch_radius - s.cladding for axle in s.axles]
        return np.min([band, *arches], axis=0) if s.cladding > 0.004 else band

    return distance


def bed(outline: Outline) -> Region:
    """The opening of a load bed: the deck between the side rails."""
    corners = outline.landmarks
    rear, front, height = corners[1, 0] + 0.012, corners[2, 0] - 0.006, corners[1, 1] - 0.03

    def distance(p: Float[ndarray, "vertices 3"]) -> Float[ndarray, " vertices"]:
        rails = np.abs(p[:, 0]) - outline.half_width(p[:, 2], p[:, 1]) + 0.022
        return np.max([rails, rear - p[:, 2], p[:, 2] - front, height - p[:, 1]], axis=0)

    return distance


def wheel_boxes(outline: Outline) -> Region:
    """The strips along a load bed's sides that make room for the wheels."""

    def distance(p: Float[ndarray, "vertices 3"]) -> Float[ndarray, " vertices"]:
        return outline.half_width(p[:, 2], p[:, 1]) - 1.5 * outline.shape.wheel_width - 0.016 - np.abs(p[:, 0])

    return distance
