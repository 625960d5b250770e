"""What a camera sees at points of its picture: against planes with known answers, and rays against every triangle."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from svbrdfgan.config.choices import PartSelection
from svbrdfgan.geometry.camera_hits import camera_hits
from svbrdfgan.plugins.registry import load_embedding
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.vehicle import build_vehicle
from svbrdfgan.scene.subject import make_subject
from svbrdfgan.testing.rays import seen
from svbrdfgan.testing.scenes import constant_light, joined, quad, with_alpha
from svbrdfgan.types import Camera, Surface, View

FRONT = Camera((0.0, 0.0, 3.0), vertical_fov=2.0 * math.atan(0.5))
"""It sees a plane through the origin from -1.5 to 1.5 in height."""


def wall(z: float = 0.0, low: tuple[float, float] = (-1.0, -1.0), size: tuple[float, float] = (2.0, 2.0)) -> Surface:
    return quad((*low, z), (size[0], 0.0, 0.0), (0.0, size[1], 0.0))


def vehicle() -> Surface:
    mesh = build_vehicle(sample_vehicle("sedan", 3))
    return make_subject(mesh, load_embedding("hemispherical", {"resolution": 16}), 16, PartSelection()).surface


def assert_as_by_rays(surface: Surface, camera: Camera, width: int, height: int) -> None:
    """The hits at the pixels' centres are those of rays. Rays that graze an edge may disagree: at most one in 200."""
    hits = camera_hits(surface, camera, width, height)
    rays = seen(surface, View(camera, constant_light(), width, height), 1)
    part = np.full(width * height, -1)
    part[rays.pixel] = rays.part
    assert (part != hits.part.ravel()).mean() <= 0.005
    both = rays.at(hits.part.ravel()[rays.pixel] == rays.part)
    assert len(both.pixel) > 0.15 * width * height
    position, normal = (
        values.reshape(-1, 3)[both.pixel] for values in (hits.interpolate(surface.positions), hits.normals())
    )
    depth = (both.position - camera.origin) @ -camera.basis()[2]
    near = np.linalg.norm(position - both.position, axis=1) < 1e-6
    assert near.mean() > 0.995
    np.testing.assert_allclose(normal[near], both.normal[near], atol=1e-6)
    np.testing.assert_allclose(hits.depth.ravel()[both.pixel][near], depth[near], atol=1e-6)


def test_a_plane_has_its_depth_and_normal_and_nothing_else_has() -> None:
    hits = camera_hits(wall(), FRONT, 6, 6)
    inside = np.zeros((6, 6), bool)
    inside[1:5, 1:5] = True
    assert (hits.hit == inside).all()
    np.testing.assert_allclose(hits.depth, np.where(inside, 3.0, 0.0), atol=1e-12)
    np.testing.assert_allclose(hits.normals(), np.where(inside[..., None], [0.0, 0.0, 1.0], 0.0), atol=1e-12)
    assert (hits.part == np.where(inside, 0, -1)).all()


def test_rows_go_down_and_columns_to_the_right() -> None:
    hits = camera_hits(wall(low=(0.0, 0.0), size=(1.0, 1.0)), FRONT, 12, 6)
    rows, cols = np.nonzero(hits.hit)
    assert {*rows} == {1, 2}
    assert {*cols} == {6, 7}
    np.testing.assert_allclose(hits.interpolate(hits.surface.positions)[2, 6], [0.25, 0.25, 0.0], atol=1e-12)


def test_the_nearest_wins_and_normals_are_turned_to_the_camera() -> None:
    behind = Camera((0.0, 0.0, -3.0), vertical_fov=FRONT.vertical_fov)
    walls = joined(wall(), wall(0.5, size=(1.0, 2.0)))
    assert {*camera_hits(walls, FRONT, 6, 6).part[2, 1:5]} == {0, 1}
    assert {*camera_hits(walls, behind, 6, 6).part[2, 1:5]} == {0}
    np.testing.assert_allclose(camera_hits(walls, behind, 6, 6).normals()[2, 2], [0.0, 0.0, -1.0], atol=1e-12)


def test_the_middle_of_several_points_is_the_centre() -> None:
    surface, camera = vehicle(), Camera((0.6, 0.4, 0.9), (0.0, 0.15, 0.0))
    one, many = camera_hits(surface, camera, 16, 12), camera_hits(surface, camera, 16, 12, 5)
    assert (many.centres(5).face == one.face).mean() > 0.99
    np.testing.assert_allclose(many.centres(5).depth, one.depth, atol=1e-6)


@pytest.mark.parametrize(
    "camera",
    [
        Camera((0.6, 0.4, 0.9), (0.0, 0.15, 0.0)),
        Camera((0.02, 0.2, 0.05), (0.08, 0.15, 0.5), vertical_fov=math.radians(80.0)),
        Camera((0.0, 1.0, 0.1), (0.0, 0.0, 0.1), up=(0.0, 0.0, 1.0)),
    ],
    ids=["outside", "inside the vehicle", "above"],
)
def test_hits_are_those_of_rays(camera: Camera) -> None:
    assert_as_by_rays(vehicle(), camera, 16, 12)


@pytest.mark.parametrize(("alpha", "part"), [(0.4, 0), (0.6, 1)])
def test_what_is_rather_transparent_is_seen_through(alpha: float, part: int) -> None:
    walls = with_alpha(joined(wall(), wall(0.5)), 1.0, alpha)
    assert camera_hits(walls, FRONT, 6, 6).part[3, 3] == part


def test_a_texture_of_alpha_cuts_out() -> None:
    holes = np.zeros((2, 8))
    holes[:, 4:] = 1.0  # the right half of the front wall is there
    walls = with_alpha(joined(wall(), wall(0.5)), 1.0, holes)
    row = camera_hits(walls, FRONT, 12, 6).part[3]
    assert [*row[4:8]] == [0, 0, 1, 1]


def test_nothing_before_the_camera_is_no_hit() -> None:
    away = replace(FRONT, target=(0.0, 0.0, 6.0))
    assert not camera_hits(wall(), away, 4, 4).hit.any()
