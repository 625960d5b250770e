"""The scenes that are timed: the standard scene, and a real mesh under a real environment.

The standard scene has a million vertices, one texture and a hazy sky with a small bright sun. Fixed seeds make
it, so that every program does the same work: direct light in a picture of 256x256 pixels, and the gradient of
mean(image**2) with respect to the texture of 512x512 texels.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray

from svbrdfgan.bench.bench_scene import BenchScene
from svbrdfgan.bench.cases import PIXELS, TEXELS, VERTICES
from svbrdfgan.config.choices import PartSelection
from svbrdfgan.data.sampler import fit_distance
from svbrdfgan.geometry.normals import corner_normals
from svbrdfgan.io.environment import load_environment
from svbrdfgan.io.mesh import load_mesh
from svbrdfgan.protocols import UVEmbedding
from svbrdfgan.scene.subject import Subject, make_subject
from svbrdfgan.types import Camera, Environment, Mesh, Part, Surface, View

# The camera that looks at a vehicle, from its front left and above.
_AZIMUTH = math.radians(40.0)
_ELEVATION = math.radians(20.0)
_FOV = math.radians(35.0)  # vertical field of view

_RADII = np.array([1.6, 0.6, 0.8])  # of the standard scene's ellipsoid, along x, y and z
_CAMERA = Camera(origin=(2.5, 1.5, 4.0), target=(0.0, 0.0, 0.0), vertical_fov=math.radians(40.0))


def standard_scene(vertices: int = VERTICES, pixels: int = PIXELS, texels: int = TEXELS) -> BenchScene:
    """A rippled ellipsoid in one part; the number of vertices is rounded to a square.

    The shading normals of a million vertices take some seconds.
    """
    view = View(_CAMERA, _environment(), pixels, pixels)
    return BenchScene.of(_surface(max(3, round(math.sqrt(vertices)))), view, noise(texels), np.zeros((1, 3)))


def glossy_scene(scene: BenchScene) -> BenchScene:
    """The same scene with noise in all maps of part 0: rough and smooth, metal and paint, tilted by up to 30°."""
    rows, cols, _ = scene.texture.shape
    random = np.random.RandomState(2).rand(rows, cols, 4).astype(np.float32)
    tilt = np.concatenate([0.8 * random[..., 2:] - 0.4, np.ones((rows, cols, 1), np.float32)], axis=2)
    normal = tilt / np.linalg.norm(tilt, axis=2, keepdims=True)
    gloss = np.concatenate([0.2 + 0.7 * random[..., :1], random[..., 1:2], normal], axis=2)
    return replace(scene, gloss=gloss)


def noise(texels: int) -> Float[ndarray, "rows cols 3"]:
    """White noise between 0 and 0.8 in every texel, so that no renderer profits from smoothness."""
    return np.float32(0.8) * np.random.RandomState(1).rand(texels, texels, 3).astype(np.float32)


def _surface(side: int) -> Surface:
    """Open by a hair at both poles; u runs around it, v from top to bottom."""
    uv = _grid(side)
    positions, faces = _ripple(uv), _quads(side)
    column = faces % side
    welded = np.where(column == side - 1, faces - column, faces)  # the last column of vertices coincides with the first
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


def vehicle_scene(mesh: Path, environment: Path, embedding: UVEmbedding, pixels: int, texels: int) -> BenchScene:
    """The mesh from the front left, embedded as for training.

    The learnable parts are merged into one with the texture. Other parts and hidden layers have their mean colour.

    Raises:
        AssetError: a file cannot be read, or no visible part is learnable.
        EmbeddingError: the mesh cannot be embedded.
    """
    loaded, light = load_mesh(mesh), Environment(load_environment(environment))
    start = time.perf_counter()
    subject = make_subject(loaded, embedding, texels, PartSelection())
    seconds = time.perf_counter() - start
    others = [part for part in range(len(subject.surface.parts)) if part not in subject.learnable]
    renumbered = np.zeros(len(subject.surface.parts), np.int64)
    renumbered[others] = np.arange(len(others)) + 1
    surface = replace(
        subject.surface,
        face_part=renumbered[subject.surface.face_part],
        parts=(Part("learnable"), *(Part(f"other {number}") for number in range(len(others)))),
    )
    view = View(_camera(loaded), light, pixels, pixels)
    return BenchScene.of(surface, view, noise(texels), _colors(subject, others), seconds)


def _camera(mesh: Mesh) -> Camera:
    """A camera at the distance where the sphere around the mesh's bounding box just fits into a square picture."""
    low, high = mesh.bounds
    x, y, z = ((low + high) / 2).tolist()
    distance = fit_distance(float(np.linalg.norm(high - low)) / 2, _FOV, aspect=1.0)
    return Camera.orbit(_AZIMUTH, _ELEVATION, distance, (x, y, z), _FOV)


def _colors(subject: Subject, others: list[int]) -> Float[ndarray, "parts 3"]:
    """Mean colours of the other parts, after a black one for the merged learnable part."""
    means = [subject.base[part].reshape(-1, 3).mean(dim=0) for part in others]
    return torch.stack([torch.zeros(3), *means]).numpy()
