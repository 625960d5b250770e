"""Cutting changes no geometry, leaves no gaps, and every piece knows where it came from."""

import numpy as np
import pytest
import trimesh
from jaxtyping import Bool, Int
from numpy import ndarray

from svbrdfgan.geometry.normals import corner_normals, face_areas, face_normals
from svbrdfgan.geometry.subdivide import Pieces, refine, unique_edges


def at_random(
    pieces: Pieces, edges: Int[ndarray, "edges 2"], face_edges: Int[ndarray, "faces 3"]
) -> Bool[ndarray, " n"]:
    return np.random.default_rng(len(edges)).random(len(edges)) < 0.4


@pytest.fixture(scope="module")
def ball() -> trimesh.Trimesh:
    return trimesh.creation.icosphere(subdivisions=2)


@pytest.fixture(scope="module")
def pieces(ball: trimesh.Trimesh) -> Pieces:
    return refine(Pieces.whole(ball.vertices, ball.faces), at_random, rounds=3)


def test_a_closed_mesh_stays_closed(pieces: Pieces) -> None:
    edges, face_edges = unique_edges(pieces.faces)
    assert len(pieces.faces) > 300
    assert (np.bincount(face_edges.ravel(), minlength=len(edges)) == 2).all()


def test_pieces_lie_where_their_source_says(ball: trimesh.Trimesh, pieces: Pieces) -> None:
    corners = pieces.interpolate(ball.vertices[ball.faces])
    assert np.abs(corners - pieces.positions[pieces.faces]).max() < 1e-15


def test_winding_and_area_are_kept(ball: trimesh.Trimesh, pieces: Pieces) -> None:
    before = face_normals(ball.vertices, ball.faces)[pieces.source_face]
    assert np.allclose(face_normals(pieces.positions, pieces.faces), before)
    area = np.bincount(pieces.source_face, face_areas(pieces.positions, pieces.faces))
    assert np.allclose(area, face_areas(ball.vertices, ball.faces))


def test_normals_at_shared_points_agree_and_old_ones_stay(ball: trimesh.Trimesh, pieces: Pieces) -> None:
    normals = pieces.interpolate(corner_normals(ball.vertices, ball.faces)).reshape(-1, 3)
    seen = np.zeros((len(pieces.positions), 3))
    seen[pieces.faces.ravel()] = normals
    assert np.allclose(normals, seen[pieces.faces.ravel()])
    assert np.allclose(seen[: len(ball.vertices)], ball.vertices, atol=0.02)


def test_a_predicate_that_is_never_content_stops(ball: trimesh.Trimesh) -> None:
    always = refine(Pieces.whole(ball.vertices, ball.faces), lambda p, edges, f: np.ones(len(edges), bool), rounds=2)
    assert len(always.faces) == 16 * len(ball.faces)
