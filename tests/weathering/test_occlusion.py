"""Visibility and mean curvature against answers known without them."""

import numpy as np
import pytest
import trimesh

from svbrdfgan.weathering.occlusion import ambient_visibility, mean_curvature, scatter

UP = np.array([0.0, 1.0, 0.0])


def test_scatter_is_even_whatever_the_faces(shapes):
    surface = shapes.flat(shapes.floor())
    points, normals = scatter(surface, 0.02)
    assert len(points) == pytest.approx(4.0 / 0.02**2, abs=2)
    assert np.array_equal(normals, np.tile(UP, (len(points), 1)))
    counts, *_ = np.histogram2d(points[:, 0], points[:, 2], bins=10, range=[[-1, 1], [-1, 1]])
    assert counts.std() < 0.1 * counts.mean()


def test_scatter_takes_only_the_faces_asked_for(shapes):
    surface = shapes.flat(shapes.floor(0.0), shapes.floor(1.0))
    points, _ = scatter(surface, 0.1, np.array([False, True, False, True]))
    assert np.allclose(points[:, 1], 1.0)


def test_open_plane_and_sphere_are_open(shapes):
    surface = shapes.flat(shapes.floor())
    points = np.random.default_rng(0).uniform(-0.9, 0.9, (200, 3)) * [1, 0, 1]
    assert ambient_visibility(surface, points, np.tile(UP, (200, 1))).min() > 0.97
    ball = shapes.sphere(2.0)
    assert ambient_visibility(ball, ball.positions, ball.normals).min() > 0.95


def test_inside_a_closed_box_nothing_is_open(shapes):
    surface = shapes.quads(*shapes.box_sides((-1, -1, -1), (1, 1, 1), inward=True))
    points = np.array([[0.0, -1.0, 0.0], [0.5, -1.0, -0.4]])
    assert ambient_visibility(surface, points, np.tile(UP, (2, 1))).max() < 0.02


def test_bottom_of_a_deep_open_box_is_nearly_closed_and_its_rim_is_not(shapes):
    corners, normals = shapes.box_sides((-0.25, 0, -0.25), (0.25, 2, 0.25), inward=True)
    shaft = shapes.quads(np.delete(corners, 3, axis=0), np.delete(normals, 3, axis=0))
    points = np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 1.9, 0.0]])
    bottom, middle, top = ambient_visibility(shaft, points, np.tile(UP, (3, 1)))
    assert bottom < 0.06
    assert bottom < middle < top
    assert top > 0.8


def test_under_a_wide_roof_it_is_dark_and_on_top_it_is_open(shapes):
    surface = shapes.flat(shapes.floor(0.0), shapes.floor(0.2))
    below, above = ambient_visibility(surface, np.array([[0.0, 0.0, 0.0], [0.0, 0.2, 0.0]]), np.tile(UP, (2, 1)))
    assert below < 0.15
    assert above > 0.97


def test_half_plane_wall_halves_the_light_at_its_foot(shapes):
    wall = np.array([[0.0, 0, -20], [0, 20, -20], [0, 20, 20], [0, 0, 20]])
    ground = np.array([[0.0, 0, -20], [0, 0, 20], [20, 0, 20], [20, 0, -20]])
    surface = shapes.quads(np.array([wall, ground]), np.array([[1.0, 0, 0], UP]))
    assert ambient_visibility(surface, np.array([[0.6, 0.0, 0.0]]), UP[None])[0] == pytest.approx(0.5, abs=0.08)


@pytest.mark.parametrize("radius", [0.5, 3.0])
def test_bend_of_a_sphere_is_its_curvature_and_of_a_hollow_one_the_opposite(shapes, radius):
    ball = shapes.sphere(radius)
    assert np.allclose(mean_curvature(ball, ball.positions, ball.normals, 0.3 * radius), 0.3, atol=0.01)
    hollow = shapes.make_surface(ball.positions, -ball.normals, ball.faces[:, ::-1])
    assert np.allclose(mean_curvature(hollow, ball.positions, -ball.normals, 0.3 * radius), -0.3, atol=0.01)


def test_bend_is_zero_on_planes_even_on_thin_sheets(shapes):
    sheet = shapes.flat(shapes.floor(0.0, normal=-UP), shapes.floor(0.01))
    points = np.array([[0.0, 0.01, 0.0], [0.3, 0.01, -0.2]])
    assert np.allclose(mean_curvature(sheet, points, np.tile(UP, (2, 1)), 0.1), 0.0, atol=1e-6)


def test_bend_tells_edges_from_creases(shapes):
    outside, inside = (
        shapes.quads(*shapes.box_sides((0, 0, 0), (1, 1, 1))),
        shapes.quads(*shapes.box_sides((0, 0, 0), (1, 1, 1), inward=True)),
    )
    near_edge, middle = np.array([[0.5, 1.0, 0.98]]), np.array([[0.5, 1.0, 0.5]])
    assert mean_curvature(outside, near_edge, UP[None], 0.1)[0] > 0.3
    assert mean_curvature(inside, near_edge, -UP[None], 0.1)[0] < -0.3
    assert abs(mean_curvature(outside, middle, UP[None], 0.1)[0]) < 1e-6


def test_neither_depends_on_how_the_surface_is_cut_into_faces(shapes):
    coarse = shapes.quads(*shapes.box_sides((0, 0, 0), (1, 1, 1)))
    positions, faces = trimesh.remesh.subdivide_to_size(coarse.positions, coarse.faces, 0.3)
    axis = np.abs(positions[faces].mean(axis=1) - 0.5).argmax(axis=1)
    outward = np.eye(3)[axis] * np.sign(positions[faces].mean(axis=1) - 0.5)
    fine = shapes.make_surface(
        positions[faces].reshape(-1, 3), np.repeat(outward, 3, axis=0), np.arange(3 * len(faces)).reshape(-1, 3)
    )
    points = np.array([[0.5, 1.0, 0.97], [0.2, 1.0, 0.4], [0.9, 1.0, 0.9]])
    up = np.tile(UP, (3, 1))
    assert np.allclose(ambient_visibility(coarse, points, up), ambient_visibility(fine, points, up), atol=0.05)
    assert np.allclose(mean_curvature(coarse, points, up, 0.1), mean_curvature(fine, points, up, 0.1), atol=0.12)


def test_faces_in_one_place_need_no_more_points_than_memory_holds(shapes, monkeypatch):
    monkeypatch.setattr("svbrdfgan.weathering.occlusion._MOST", 100)
    points, normals = scatter(shapes.flat(shapes.floor()), 1e-6)
    assert points.shape == normals.shape == (100, 3)
