"""Surfaces whose maps are known in closed form."""

from collections.abc import Callable

import numpy as np
from numpy import ndarray

from svbrdfgan.types import Part, Surface

Map = Callable[[ndarray], ndarray]


def surface_of(positions: ndarray, faces: ndarray, uv: ndarray, hidden: ndarray | None = None, **fields) -> Surface:
    """A surface with these UVs per vertex, or per face corner (faces, 3, 2)."""
    faces = np.asarray(faces, dtype=np.int64)
    positions, uv = np.asarray(positions, dtype=float), np.asarray(uv, dtype=float)
    if uv.ndim == 3:
        positions, uv, faces = positions[faces.ravel()], uv.reshape(-1, 2), np.arange(faces.size).reshape(-1, 3)
    return Surface(
        positions=positions,
        normals=np.tile([0.0, 1.0, 0.0], (len(positions), 1)),
        uv=uv,
        faces=faces,
        face_part=np.zeros(len(faces), dtype=np.int64) if hidden is None else hidden.astype(np.int64),
        parts=(Part("seen"), Part("beneath", hidden_half_of="seen")),
        elevation=np.zeros(len(positions)),
        source_face=np.arange(len(faces)),
        source_barycentric=np.tile(np.eye(3), (len(faces), 1, 1)),
        **fields,
    )


def grid(cols: int, rows: int) -> tuple[ndarray, ndarray]:
    """A grid of squares over the unit square: its vertices, and triangles counter-clockwise."""
    s, t = np.meshgrid(np.linspace(0, 1, cols + 1), np.linspace(0, 1, rows + 1))
    index = np.arange(s.size).reshape(s.shape)
    a, b, c, d = (v.ravel() for v in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]))
    return np.column_stack([s.ravel(), t.ravel()]), np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def sheet(shape: Map, cols: int = 8, rows: int = 8, uv: Map = lambda st: st, **fields) -> Surface:
    """The surface of a map from the unit square to space, cut into cols x rows squares, and its UVs likewise."""
    st, faces = grid(cols, rows)
    return surface_of(shape(st), faces, uv(st), **fields)


def flat(width: float, height: float) -> Map:
    """An upright rectangle that faces +Z."""
    return lambda st: np.column_stack([st * (width, height), np.zeros(len(st))])


def cylinder(radius: float, height: float) -> Map:
    """Around +Y, open, its outside facing out."""
    return lambda st: np.column_stack(
        [
            radius * np.sin(2 * np.pi * st[:, 0]),
            height * st[:, 1],
            radius * np.cos(2 * np.pi * st[:, 0]),
        ]
    ).round(12)


def dome(st: ndarray) -> ndarray:
    """The upper half of the unit sphere by equation 4.1 of the thesis: poles along Z."""
    theta, phi = np.pi * st.T
    return np.column_stack([-np.sin(phi) * np.cos(theta), np.sin(phi) * np.sin(theta), np.cos(phi)])
