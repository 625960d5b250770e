"""Surfaces whose topology and best maps are known."""

import numpy as np
import pytest

Surface = tuple[np.ndarray, np.ndarray]


def rectangle(columns: int, rows: int, width: float, height: float) -> Surface:
    """Flat, in the ground plane, facing up; u along +X, v along -Z."""
    x, z = np.meshgrid(np.linspace(0, width, columns + 1), -np.linspace(0, height, rows + 1), indexing="ij")
    vertex = np.arange(x.size).reshape(x.shape)
    a, b, c, d = (v.ravel() for v in (vertex[:-1, :-1], vertex[1:, :-1], vertex[1:, 1:], vertex[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return np.stack([x.ravel(), np.zeros(x.size), z.ravel()], axis=1), faces


def ring(around: int, across: int) -> Surface:
    """A torus: closed, genus one, wound outward."""
    s, t = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    u, v = 2 * np.pi * s / around, 2 * np.pi * t / across
    radius = 1.0 + 0.4 * np.cos(v)
    points = np.stack([radius * np.cos(u), 0.4 * np.sin(v), -radius * np.sin(u)], axis=-1).reshape(-1, 3)
    a, b, c, d = (((s + i) % around * across + (t + j) % across).ravel() for i, j in ((0, 0), (1, 0), (1, 1), (0, 1)))
    return points, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def dome(rings: int, sides: int) -> Surface:
    """Half a sphere, open below, wound outward."""
    polar, turn = np.meshgrid(
        np.linspace(0, np.pi / 2, rings + 1)[1:], 2 * np.pi * np.arange(sides) / sides, indexing="ij"
    )
    points = np.stack([np.sin(polar) * np.sin(turn), np.cos(polar), np.sin(polar) * np.cos(turn)], axis=-1)
    i, j = np.meshgrid(np.arange(rings - 1), np.arange(sides), indexing="ij")
    a, b, c, d = (1 + ((i + k) * sides + (j + m) % sides).ravel() for k, m in ((0, 0), (1, 0), (1, 1), (0, 1)))
    top = np.stack([np.zeros(sides, np.int64), 1 + np.arange(sides), 1 + (np.arange(sides) + 1) % sides], axis=1)
    faces = np.concatenate([top, np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return np.concatenate([[[0.0, 1.0, 0.0]], points.reshape(-1, 3)]), faces


@pytest.fixture
def square() -> Surface:
    return rectangle(8, 8, 1.0, 1.0)


@pytest.fixture
def oblong() -> Surface:
    return rectangle(6, 12, 1.0, 2.0)


@pytest.fixture
def torus() -> Surface:
    return ring(24, 12)


@pytest.fixture
def hemisphere() -> Surface:
    return dome(8, 24)
