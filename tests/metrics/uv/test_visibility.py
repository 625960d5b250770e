"""What is seen from outside, where that is known; and the rays that find it."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from known_maps import flat, sheet, surface_of

from svbrdfgan.metrics.uv.point_location import PointLocator
from svbrdfgan.metrics.uv.visibility import VisibleSurface, visible_surface
from svbrdfgan.types import Surface


def of_meshes(*meshes: trimesh.Trimesh, hidden: int = 0) -> Surface:
    """Their faces as one surface, with UVs of no meaning; the last `hidden` of them in a hidden part."""
    joined = trimesh.util.concatenate(list(meshes))
    owner = np.repeat(np.arange(len(meshes)), [len(mesh.faces) for mesh in meshes])
    uv = np.random.default_rng(0).uniform(size=(len(joined.vertices), 2))
    return surface_of(joined.vertices, joined.faces, uv, hidden=owner >= len(meshes) - hidden)


def ball(radius: float = 1.0) -> trimesh.Trimesh:
    return trimesh.creation.icosphere(subdivisions=2, radius=radius)


def sides_seen(found: VisibleSurface) -> set[tuple[int, int]]:
    """Which sides of an upright box: axis and sign."""
    normals = np.cross(*(found.positions[found.faces[:, k]] - found.positions[found.faces[:, 0]] for k in (1, 2)))
    axis = np.abs(normals).argmax(axis=1)
    return {(int(a), int(np.sign(n[a]))) for a, n in zip(axis, normals, strict=True)}


def test_a_ball_within_a_ball_is_not_seen() -> None:
    found = visible_surface(of_meshes(ball(), ball(0.5)))
    assert np.linalg.norm(found.positions[found.faces], axis=2).min() > 0.9
    assert found.seen == pytest.approx(0.8, abs=0.02)  # of 1 + 0.5^2, less the very bottom
    assert found.areas.sum() == pytest.approx(ball().area, rel=0.03)
    assert found.kept == 1.0


def test_a_box_is_seen_but_for_its_bottom() -> None:
    found = visible_surface(of_meshes(trimesh.creation.box()))
    assert sides_seen(found) == {(0, 1), (0, -1), (1, 1), (2, 1), (2, -1)}
    assert found.areas.sum() == pytest.approx(5.0)


def test_an_open_box_shows_its_floor_from_above() -> None:
    box = trimesh.creation.box()
    box.update_faces(box.face_normals[:, 1] < 0.5)
    found = visible_surface(of_meshes(box))
    assert (1, 1) in sides_seen(found)  # the floor, from within
    assert found.seen == pytest.approx(1.0)


def test_what_is_wound_inward_is_turned() -> None:
    inward = ball()
    inward.invert()
    found = visible_surface(of_meshes(inward))
    middle = found.positions[found.faces].mean(axis=1)
    p, q = (found.positions[found.faces[:, k]] - found.positions[found.faces[:, 0]] for k in (1, 2))
    assert (np.einsum("fx,fx->f", np.cross(p, q), middle) > 0).all()


@pytest.mark.parametrize("mirror", [False, True])
def test_mirrored_means_as_seen_from_outside(mirror: bool) -> None:
    """Turning the winding over does not make a map mirrored; turning the map over does."""
    dome = ball()
    dome.update_faces(dome.triangles_center[:, 1] > 0)
    for faces in (dome.faces, dome.faces[:, ::-1]):
        uv = 0.5 + 0.4 * dome.vertices[:, [0, 2]] * (1, 1 if mirror else -1)
        found = visible_surface(surface_of(dome.vertices, faces, uv))
        assert (found.uv_areas < 0).mean() == pytest.approx(float(mirror), abs=0.02)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_sheet_seen_from_both_sides_keeps_its_winding(side: float) -> None:
    found = visible_surface(sheet(lambda st: flat(1.0, 1.0)(st) * (side, 1, 1)))
    assert sides_seen(found) == {(2, int(side))}


def test_hidden_parts_do_not_count_and_are_told() -> None:
    beside = ball()
    beside.apply_translation((5, 0, 0))
    found = visible_surface(of_meshes(ball(), beside, hidden=1))
    assert found.kept == pytest.approx(0.5, abs=0.02)
    assert found.positions[found.faces, 0].max() < 2.0


def test_hidden_parts_still_stand_in_the_way() -> None:
    found = visible_surface(of_meshes(ball(0.5), ball(), hidden=1))
    assert found.kept == 0.0
    assert len(found.faces) == 0


def test_pieces_keep_their_place_in_the_map() -> None:
    """UV is an affine function of position before and after."""
    found = visible_surface(sheet(flat(2.0, 1.0), 3, 2))
    np.testing.assert_allclose(found.uv, found.positions[found.faces][:, :, :2] / (2, 1), atol=1e-12)
    assert len(found.faces) > 1000


def test_size_and_place_do_not_matter() -> None:
    surface = of_meshes(ball(), ball(0.5))
    moved = replace(surface, positions=surface.positions * 1e-3 + (5, 0, 7))
    assert visible_surface(moved).seen == pytest.approx(visible_surface(surface).seen, abs=1e-3)


def test_rays_find_what_brute_force_finds() -> None:
    random = np.random.default_rng(1)
    corners = random.uniform(size=(300, 1, 2)) + 0.2 * random.normal(size=(300, 3, 2))
    points = random.uniform(-0.2, 1.2, size=(500, 2))
    pieces = [np.column_stack([hits.point, hits.triangle]) for hits in PointLocator.of(corners).locate(points)]
    found = set(map(tuple, np.concatenate(pieces).tolist()))
    side = np.stack([_cross(corners[:, k - 2], corners[:, k - 1], points) for k in range(3)])
    inside = (side > 0).all(axis=0) | (side < 0).all(axis=0)
    assert found == set(map(tuple, np.argwhere(inside).tolist()))
    height, level = random.uniform(size=(300, 3)), random.uniform(size=500)
    locator = PointLocator.of(corners, ranked=np.argsort(-height.max(axis=1)))
    above = np.zeros(500, dtype=bool)
    for hits in PointLocator.of(corners).locate(points):
        here = (hits.barycentric * height[hits.triangle]).sum(axis=1)
        np.testing.assert_allclose(
            np.einsum("sk,skx->sx", hits.barycentric, corners[hits.triangle]), points[hits.point], atol=1e-9
        )
        above[hits.point[here > level[hits.point]]] = True
    np.testing.assert_array_equal(locator.any_higher(points, level, height), above)


def _cross(a: np.ndarray, b: np.ndarray, points: np.ndarray) -> np.ndarray:
    along, to = (b - a)[None], points[:, None] - a[None]
    return along[..., 0] * to[..., 1] - along[..., 1] * to[..., 0]
