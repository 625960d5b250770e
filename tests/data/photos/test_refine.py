"""Cameras are refined by the outline of a mask: from some degrees and percent off to a fraction of that."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from svbrdfgan.data.photos.overlay import visible_depth
from svbrdfgan.data.photos.refine import refine_camera
from svbrdfgan.io.mesh import load_mesh
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.vehicle import build_vehicle
from svbrdfgan.types import Camera, Mesh

SIZE = (512, 384)


@pytest.fixture(scope="module")
def car() -> Mesh:
    return build_vehicle(sample_vehicle("hatchback", seed=3))


def mask_of(camera: Camera, mesh: Mesh) -> Tensor:
    return torch.from_numpy(np.isfinite(visible_depth(mesh, camera, *SIZE)).copy()).float()


def pair(mesh: Mesh, rng: np.random.Generator, error: float) -> tuple[Camera, Camera]:
    """A camera before a mesh, and the same off by so many degrees and percent, by standard deviation."""
    middle, length = mesh.bounds.mean(axis=0), float(np.ptp(mesh.positions, axis=0).max())
    azimuth, elevation = rng.uniform(0, 2 * math.pi), math.radians(rng.uniform(3, 30))
    distance, target, off = (
        rng.uniform(1.5, 2.5) * length,
        middle + 0.02 * length * rng.normal(size=3),
        rng.normal(size=7),
    )

    def camera(by: np.ndarray) -> Camera:
        turn, share = math.radians(error) * by[:2], error / 100 * by
        x, y, z = (target + share[3:6] * length / 3).tolist()
        far, angle = distance * (1 + share[2]), math.radians(38) * (1 + share[6])
        return Camera.orbit(azimuth + turn[0], elevation + turn[1], far, (x, y, z), angle)

    return camera(np.zeros(7)), camera(off)


def errors(found: Camera, true: Camera, mesh: Mesh) -> tuple[float, float, float, float]:
    """Degrees about the middle, degrees of view, percent of distance, percent of the size in the picture."""
    sights = [np.asarray(one.origin) - mesh.bounds.mean(axis=0) for one in (found, true)]
    far, wanted = (float(np.linalg.norm(sight)) for sight in sights)
    about = math.degrees(math.acos(float(np.clip(sights[0] @ sights[1] / far / wanted, -1, 1))))
    view = math.degrees(Rotation.from_matrix(found.basis() @ true.basis().T).magnitude())
    zoom = math.tan(true.vertical_fov / 2) / math.tan(found.vertical_fov / 2)
    return about, view, 100 * abs(far / wanted - 1), 100 * abs(far / wanted / zoom - 1)


def test_cameras_some_degrees_off_come_back(car: Mesh) -> None:
    rng = np.random.default_rng(0)
    before, after = [], []
    for _ in range(4):
        true, claimed = pair(car, rng, 5.0)
        found, refinement = refine_camera(claimed, car, mask_of(true, car))
        assert refinement.after > max(refinement.before, 0.98)
        before.append(errors(claimed, true, car))
        after.append(errors(found, true, car))
    about, view, _, size = np.median(after, axis=0) / np.median(before, axis=0)
    assert about < 0.2
    assert view < 0.2
    assert size < 0.2


def test_a_camera_that_fits_stays(car: Mesh) -> None:
    true, _ = pair(car, np.random.default_rng(1), 0.0)
    found, refinement = refine_camera(true, car, mask_of(true, car))
    assert refinement.before == pytest.approx(1, abs=0.01)
    assert refinement.degrees < 0.3
    assert max(errors(found, true, car)[:2]) < 0.3


def test_without_an_outline_nothing_changes(car: Mesh) -> None:
    true, _ = pair(car, np.random.default_rng(2), 0.0)
    found, refinement = refine_camera(true, car, torch.zeros(SIZE[::-1]))
    assert found == true
    assert (refinement.degrees, refinement.percent, refinement.after) == pytest.approx((0, 0, 0), abs=1e-4)


@pytest.mark.full
def test_of_real_vehicles(assets: Path) -> None:
    """`python -m pytest -m full -s tests/data/photos/test_refine.py` prints the table of docs/lab/own-pictures.md."""
    names = ("kenney_sedan", "gazebo_pickup", "quaternius_real_normalcar1", "jme_modern_hatchback")
    rng = np.random.default_rng(0)
    found = []
    for name in names:
        mesh = load_mesh(assets / "cars" / f"{name}.glb")
        for _ in range(8):
            true, claimed = pair(mesh, rng, 5.0)
            refined, overlap = refine_camera(claimed, mesh, mask_of(true, mesh))
            found.append((*errors(claimed, true, mesh), overlap.before, *errors(refined, true, mesh), overlap.after))
    table = np.array(found)
    for label, share in (("median", 0.5), ("90th percentile", 0.9)):
        print(label, np.quantile(table, share, axis=0).round(3).tolist())
    about, view, _, size = np.median(table[:, 5:9], axis=0)
    assert max(about, view, size) < 0.7
