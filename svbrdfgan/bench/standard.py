"""The standard scene: a million vertices, one texture, a hazy sky with a small bright sun.

Made from fixed seeds, so that every program is timed on the same work: direct light in a picture of 256x256 pixels,
and the gradient of mean(image**2) with respect to the texture of 512x512 texels.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray

from svbrdfgan.bench.scene import BenchScene
from svbrdfgan.geometry.normals import corner_normals
from svbrdfgan.types import Camera, Environment, Part, Surface, View

VERTICES, PIXELS, TEXELS = 1_000_000, 256, 512
_RADII = np.array([1.6, 0.6, 0.8])
_CAMERA = Camera(origin=(2.5, 1.5, 4.0), target=(0.0, 0.0, 0.0), vertical_fov=math.radians(40.0))


def standard_scene(vertices: int = VERTICES, pixels: int = PIXELS, texels: int = TEXELS) -> BenchScene:
    """A rippled ellipsoid of about so many vertices, which are a square number, in one part.

    The shading normals of a million vertices take some seconds.
    """
    view = View(_CAMERA, _environment(), pixels, pixels)
    return BenchScene.of(_surface(max(3, round(math.sqrt(vertices)))), view, noise(texels), np.zeros((1, 3)))


def noise(texels: int) -> Float[ndarray, "rows cols 3"]:
    """White noise between 0 and 0.8 in every texel: no renderer gains by what is smooth."""
    return np.float32(0.8) * np.random.RandomState(1).rand(texels, texels, 3).astype(np.float32)


def _surface(side: int) -> Surface:
    """Open by a hair at both poles; u runs around it, v from top to bottom."""
    uv = _grid(side)
    positions, faces = _ripple(uv), _quads(side)
    column = faces % side
    welded = np.where(column == side - 1, faces - column, faces)  # the last column lies on the first
    normals = np.zeros_like(positions)
    normals[faces] = corner_normals(positions, welded)
    return Surface(
        positions=positions,
        normals=normals,
        uv=uv,
        faces=faces,
        face_part=np.zeros(len(faces), np.int64),
        parts=(Part("body"),),
        elevation=np.zeros(len(positions)),
        source_face=np.arange(len(faces)),
        source_barycentric=np.broadcast_to(np.eye(3), (len(faces), 3, 3)),
    )


def _grid(side: int) -> Float[ndarray, "vertices 2"]:
    """(u, v) of every vertex, row by row, rounded to single precision."""
    u, v = np.linspace(0.0, 1.0, side), np.linspace(0.001, 0.999, side)
    return np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2).astype(np.float32).astype(np.float64)


def _ripple(uv: Float[ndarray, "vertices 2"]) -> Float[ndarray, "vertices 3"]:
    around, down = uv[:, 0] * 2 * np.pi, uv[:, 1] * np.pi
    girth = np.sin(down)
    fine = 0.02 * np.sin(40 * around) * np.sin(40 * down) * girth
    coarse = 0.1 * np.sin(3 * around) * girth**2
    sphere = np.stack([girth * np.cos(around), np.cos(down), girth * np.sin(around)], axis=1)
    return (1 + fine + coarse)[:, None] * sphere * _RADII


def _quads(side: int) -> Int[ndarray, "faces 3"]:
    """Two triangles for each cell of the grid: first the upper left ones of all cells, then the lower right ones."""
    vertex = np.arange(side * side).reshape(side, side)
    here, right, below, opposite = vertex[:-1, :-1], vertex[:-1, 1:], vertex[1:, :-1], vertex[1:, 1:]
    halves = [(here, right, below), (right, opposite, below)]
    return np.concatenate([np.stack(half, axis=-1).reshape(-1, 3) for half in halves])


def _environment() -> Environment:
    """Noise about 0.4, and a sun of radiance 20 above it; turned so that the first column lies at -Z."""
    radiance = np.float32(0.3) + np.float32(0.2) * np.random.RandomState(0).rand(256, 512, 3).astype(np.float32)
    radiance[40:60, 100:130] += 20
    return Environment(torch.from_numpy(radiance), rotation=math.pi)
