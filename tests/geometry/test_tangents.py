"""Tangent frames: along growing u, mirrored where the UVs are, smooth across faces, and there for every face."""

import math
from dataclasses import replace

import numpy as np
import pytest

from svbrdfgan.geometry.tangents import corner_tangents
from svbrdfgan.testing import scenes
from svbrdfgan.types import Surface

RIGHT, TOP = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])


def with_uv(surface: Surface, matrix: list[list[float]]) -> Surface:
    """The surface with its UVs transformed about the middle of the square."""
    return replace(surface, uv=(surface.uv - 0.5) @ np.array(matrix).T + 0.5)


def frames(surface: Surface) -> tuple[np.ndarray, np.ndarray]:
    """Tangents and bitangents at face corners."""
    found = corner_tangents(surface)
    normals = surface.normals[surface.faces]
    return found.direction, found.handedness[:, None, None] * np.cross(normals, found.direction)


@pytest.mark.parametrize(
    ("matrix", "tangent", "bitangent"),
    [
        ([[1.0, 0.0], [0.0, 1.0]], RIGHT, TOP),
        ([[-1.0, 0.0], [0.0, 1.0]], -RIGHT, TOP),
        ([[1.0, 0.0], [0.0, -1.0]], RIGHT, -TOP),
        ([[0.0, 1.0], [-1.0, 0.0]], TOP, -RIGHT),
        ([[0.3, 0.0], [0.0, 0.9]], RIGHT, TOP),
    ],
)
def test_they_point_along_growing_u_and_v(
    matrix: list[list[float]], tangent: np.ndarray, bitangent: np.ndarray
) -> None:
    found, across = frames(with_uv(scenes.plane(2.0), matrix))
    np.testing.assert_allclose(found, np.broadcast_to(tangent, found.shape), atol=1e-12)
    np.testing.assert_allclose(across, np.broadcast_to(bitangent, across.shape), atol=1e-12)


def test_sheared_uvs_keep_the_direction_of_u_where_v_is_constant() -> None:
    """dP/du, not what is perpendicular to dP/dv."""
    found, _ = frames(with_uv(scenes.plane(2.0), [[1.0, 0.5], [0.0, 1.0]]))
    np.testing.assert_allclose(found, np.broadcast_to(RIGHT, found.shape), atol=1e-12)


def test_a_sheet_mirrored_in_the_middle_keeps_its_halves_apart() -> None:
    """At vertices that both halves share, each half has its own tangents."""
    positions = np.array([[x, y, 0.0] for x in (-1.0, 0.0, 1.0) for y in (0.0, 1.0)])
    faces = np.array([[0, 2, 3], [0, 3, 1], [2, 4, 5], [2, 5, 3]])
    surface = replace(
        scenes.plane(2.0),
        positions=positions,
        normals=np.tile([0.0, 0.0, 1.0], (6, 1)),
        uv=np.stack([abs(positions[:, 0]), positions[:, 1]], axis=1),
        faces=faces,
        face_part=np.zeros(4, dtype=np.int64),
        elevation=np.zeros(6),
        source_face=np.arange(4),
        source_barycentric=np.tile(np.eye(3), (4, 1, 1)),
    )
    found, across = frames(surface)
    np.testing.assert_allclose(found[:2], np.broadcast_to(-RIGHT, (2, 3, 3)), atol=1e-12)
    np.testing.assert_allclose(found[2:], np.broadcast_to(RIGHT, (2, 3, 3)), atol=1e-12)
    np.testing.assert_allclose(across, np.broadcast_to(TOP, across.shape), atol=1e-12)


def test_faces_without_area_in_uv_have_frames_too() -> None:
    surface = scenes.plane(2.0)
    none = replace(surface, uv=np.zeros_like(surface.uv))
    found, across = frames(none)
    np.testing.assert_allclose(np.linalg.norm(found, axis=2), 1.0)
    np.testing.assert_allclose(np.einsum("fkx,fkx->fk", found, none.normals[none.faces]), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(across, axis=2), 1.0)


def test_a_face_without_area_in_uv_takes_its_neighbours_tangents() -> None:
    """A mirrored quad, and a sliver between two of its corners that shares their UVs' line."""
    surface = with_uv(scenes.plane(2.0), [[-1.0, 0.0], [0.0, 1.0]])
    sliver = surface.faces[0][[0, 1, 1]]
    longer = replace(
        surface,
        faces=np.concatenate([surface.faces, sliver[None]]),
        face_part=np.zeros(len(surface.faces) + 1, dtype=np.int64),
        source_face=np.arange(len(surface.faces) + 1),
        source_barycentric=np.tile(np.eye(3), (len(surface.faces) + 1, 1, 1)),
    )
    found = corner_tangents(longer)
    np.testing.assert_allclose(found.direction[-1], np.broadcast_to(-RIGHT, (3, 3)), atol=1e-12)
    assert found.handedness[-1] == -1.0


def test_they_are_smooth_over_a_curved_surface() -> None:
    """On a cylinder's side, u around it, the corners of both faces at a vertex have the circle's tangent there."""
    angles = np.linspace(0.0, math.pi, 9)
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    positions = np.concatenate([np.insert(ring, 2, z, axis=1) for z in (0.0, 1.0)])
    faces = np.array([f for k in range(8) for f in ([k, k + 1, k + 10], [k, k + 10, k + 9])])
    surface = replace(
        scenes.plane(2.0),
        positions=positions,
        normals=np.insert(np.concatenate([ring, ring]), 2, 0.0, axis=1),
        uv=np.stack([np.tile(angles / math.pi, 2), positions[:, 2]], axis=1),
        faces=faces,
        face_part=np.zeros(16, dtype=np.int64),
        elevation=np.zeros(18),
        source_face=np.arange(16),
        source_barycentric=np.tile(np.eye(3), (16, 1, 1)),
    )
    found = corner_tangents(surface).direction
    circle = np.stack([-positions[:, 1], positions[:, 0], np.zeros(18)], axis=1)[faces]
    assert float((found * circle).sum(axis=2).min()) > 1.0 - 1e-9
