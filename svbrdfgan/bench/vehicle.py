"""A real mesh under a real environment, embedded as for training."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan.bench.scene import BenchScene
from svbrdfgan.bench.standard import noise
from svbrdfgan.config.choices import PartSelection
from svbrdfgan.data.sampler import fit_distance
from svbrdfgan.io import load_environment, load_mesh
from svbrdfgan.protocols import UVEmbedding
from svbrdfgan.scene.asset import Subject, make_subject
from svbrdfgan.types import Camera, Environment, Mesh, Part, View

_AZIMUTH, _ELEVATION, _FOV = math.radians(40.0), math.radians(20.0), math.radians(35.0)


def vehicle_scene(mesh: Path, environment: Path, embedding: UVEmbedding, pixels: int, texels: int) -> BenchScene:
    """The mesh, seen from its front and left; the texture lies on its learnable parts, which are made one.

    Other parts, and what lies beneath, keep their mean colour.

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
    """From where the sphere around the mesh's box just fits into a square picture."""
    low, high = mesh.bounds
    x, y, z = ((low + high) / 2).tolist()
    distance = fit_distance(float(np.linalg.norm(high - low)) / 2, _FOV, aspect=1.0)
    return Camera.orbit(_AZIMUTH, _ELEVATION, distance, (x, y, z), _FOV)


def _colors(subject: Subject, others: list[int]) -> Float[ndarray, "parts 3"]:
    """Of the parts that are not learnable, after a place for those that are."""
    means = [subject.base[part].reshape(-1, 3).mean(dim=0) for part in others]
    return torch.stack([torch.zeros(3), *means]).numpy()
