"""Meshes whose UVs are laid out as users' are."""

import numpy as np
from numpy import ndarray
from svbrdfgan_given.charts import signed_areas
from svbrdfgan_given.overlap import overlapping_pairs

from svbrdfgan.types import Mesh, Part, Surface


def mesh_with(positions: ndarray, faces: ndarray, uv: ndarray | None) -> Mesh:
    faces = np.asarray(faces, dtype=np.int64)
    return Mesh(np.asarray(positions, dtype=float), faces, np.zeros(len(faces), dtype=np.int64), (Part("all"),), uv)


def sheet(steps: int = 4) -> tuple[ndarray, ndarray, ndarray]:
    """A square metre in squares: positions, faces, and UVs that are the position."""
    s, t = np.meshgrid(np.linspace(0, 1, steps + 1), np.linspace(0, 1, steps + 1))
    index = np.arange(s.size).reshape(s.shape)
    a, b, c, d = (v.ravel() for v in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    positions = np.column_stack([s.ravel(), t.ravel(), np.zeros(s.size)])
    return positions, faces, positions[faces][:, :, :2]


def sheets(*uvs: ndarray) -> Mesh:
    """One sheet beside another, a chart each, with these UVs."""
    positions, faces, _ = sheet()
    count = len(uvs)
    return mesh_with(
        np.concatenate([positions + np.array([2 * k, 0, 0]) for k in range(count)]),
        np.concatenate([faces + k * len(positions) for k in range(count)]),
        np.concatenate(uvs),
    )


def small(scale: float = 0.4, offset: tuple[float, float] = (0.05, 0.05)) -> ndarray:
    """The UVs of a sheet, as a small square."""
    return sheet()[2] * scale + offset


def assert_one_to_one(surface: Surface) -> None:
    """In the unit square, nothing on top of anything else, nothing mirrored, nothing without area."""
    uv = surface.uv[surface.faces]
    assert uv.min() >= 0.0
    assert uv.max() <= 1.0
    assert signed_areas(uv).min() > 0.0
    assert sum(len(pairs) for pairs in overlapping_pairs(uv, np.zeros(len(uv), dtype=np.int64))) == 0
