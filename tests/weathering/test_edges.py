"""Distances to sharp edges against answers known without them."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from svbrdfgan.geometry.split import surface_over
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.vehicle import build_vehicle
from svbrdfgan.types import Mesh, Part, Surface
from svbrdfgan.weathering import edges
from svbrdfgan.weathering.edges import EdgeDistances, SharpEdges
from svbrdfgan.weathering.occlusion import scatter

UP = np.array([0.0, 1.0, 0.0])
REACH = 0.3


def edge_distances(surface: Surface, position: np.ndarray, normal: np.ndarray, reach: float) -> EdgeDistances:
    return SharpEdges.of(surface).distances(position, normal, reach)


def stacked(found: EdgeDistances) -> np.ndarray:
    return np.stack([found.convex, found.crease, found.border])


def counts(surface: Surface) -> tuple[int, ...]:
    found = SharpEdges.of(surface)
    return tuple(len(kind.start) for kind in (found.convex, found.crease, found.border))


def joined(*surfaces: Surface) -> Surface:
    """One surface of several, which share no vertices."""
    starts = np.cumsum([0, *(len(surface.positions) for surface in surfaces)])
    faces = np.concatenate([surface.faces + start for surface, start in zip(surfaces, starts[:-1], strict=True)])
    fields = {
        name: np.concatenate([getattr(surface, name) for surface in surfaces])
        for name in ("positions", "normals", "uv", "face_part", "elevation", "source_face", "source_barycentric")
    }
    return replace(surfaces[0], faces=faces, **fields)


def moved(surface: Surface, turn: Rotation, offset: np.ndarray, scale: float = 1.0) -> Surface:
    return replace(
        surface, positions=scale * turn.apply(surface.positions) + offset, normals=turn.apply(surface.normals)
    )


def over(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points of a floor with their normals, from x and z."""
    place = np.asarray(points, float)
    return np.stack([place[:, 0], np.zeros(len(place)), place[:, 1]], axis=1), np.tile(UP, (len(place), 1))


@pytest.fixture(scope="module")
def car() -> Surface:
    mesh = build_vehicle(sample_vehicle("hatchback", 7))
    return moved(surface_over(mesh, np.zeros((len(mesh.faces), 3, 2))), Rotation.identity(), np.zeros(3), 4.0)


def test_a_cube_has_convex_edges_alone_at_exact_distances(shapes):
    cube = shapes.quads(*shapes.box_sides((0, 0, 0), (1, 1, 1)))
    assert counts(cube) == (12, 0, 0)
    position, normal = scatter(cube, 0.02)
    found = edge_distances(cube, position, normal, REACH)
    inset = np.minimum(position, 1.0 - position)[np.abs(normal) < 0.5].reshape(-1, 2).min(axis=1)
    np.testing.assert_allclose(found.convex, np.minimum(inset, REACH), atol=1e-12)
    assert (found.crease == REACH).all()
    assert (found.border == REACH).all()


def test_the_inside_of_a_cube_has_creases_alone(shapes):
    room = shapes.quads(*shapes.box_sides((0, 0, 0), (1, 1, 1), inward=True))
    assert counts(room) == (0, 12, 0)
    found = edge_distances(room, np.array([[0.5, 0.0, 0.9], [0.5, 0.0, 0.5]]), np.tile(UP, (2, 1)), REACH)
    np.testing.assert_allclose(found.crease, [0.1, REACH])


def test_an_open_sheet_has_borders_alone(shapes):
    sheet = shapes.flat(shapes.floor())
    assert counts(sheet) == (0, 0, 4)
    found = edge_distances(sheet, *over([[0.9, 0.2], [-0.95, -0.8], [0.0, 0.0]]), REACH)
    np.testing.assert_allclose(found.border, [0.1, 0.05, REACH])


def test_two_panels_have_a_gap_between_them_and_none_where_they_touch(shapes):
    for gap, border in ((0.0, REACH), (0.004, 0.1)):
        near, far = (shapes.flat(shapes.floor()) for _ in range(2))
        pair = joined(near, moved(far, Rotation.identity(), np.array([2.0 + gap, 0.0, 0.0])))
        found = edge_distances(pair, *over([[0.9, 0.2]]), REACH)
        np.testing.assert_allclose(found.border, [border])


def test_vertices_that_differ_by_rounding_are_welded(shapes):
    cube = shapes.quads(*shapes.box_sides((0, 0, 0), (1, 1, 1)))
    noise = np.random.default_rng(0).uniform(-1e-6, 1e-6, cube.positions.shape)
    assert counts(replace(cube, positions=cube.positions + noise)) == (12, 0, 0)


def test_vertices_that_faces_share_do_as_well():
    mesh = trimesh.creation.box()
    core = Mesh(np.array(mesh.vertices), np.array(mesh.faces), np.zeros(12, int), (Part("body"),))
    assert counts(surface_over(core, np.zeros((12, 3, 2)))) == (12, 0, 0)


def test_doubled_faces_change_nothing(shapes):
    cube = shapes.quads(*shapes.box_sides((0, 0, 0), (1, 1, 1)))
    assert counts(joined(cube, cube)) == (12, 0, 0)
    other_diagonals = replace(cube, faces=cube.faces.reshape(2, -1, 3)[:, :, [1, 2, 0]].reshape(-1, 3))
    assert counts(joined(cube, other_diagonals)) == (12, 0, 0)


def test_a_sheet_with_a_back_is_convex_on_one_side_and_a_crease_on_the_other(shapes):
    cube = shapes.quads(*shapes.box_sides((0, 0, 0), (1, 1, 1)))
    both = joined(cube, replace(cube, normals=-cube.normals))
    assert counts(both) == (12, 12, 0)
    place = np.tile([0.5, 1.0, 0.9], (2, 1))
    found = edge_distances(both, place, np.stack([UP, -UP]), REACH)
    np.testing.assert_allclose(found.convex, [0.1, REACH])
    np.testing.assert_allclose(found.crease, [REACH, 0.1])


def test_a_fin_makes_creases_on_its_side_alone(shapes):
    fin = np.array([[0.0, 0, -1], [0, 0, 1], [0, 1, 1], [0, 1, -1]])
    halves = [np.array([[x, 0.0, -1], [x, 0, 1], [x + 1, 0, 1], [x + 1, 0, -1]]) for x in (-1.0, 0.0)]
    across = np.array([1.0, 0.0, 0.0])
    for side, creases in ((UP, [0.1, 0.2]), (-UP, [REACH, REACH])):
        panel = shapes.flat((halves[0], side), (halves[1], side), (fin, across), (fin, -across))
        position, _ = over([[0.1, 0.3], [-0.2, 0.3]])
        found = edge_distances(panel, position, np.tile(side, (2, 1)), REACH)
        np.testing.assert_allclose(found.crease, creases)
        assert (stacked(found)[[0, 2]] == REACH).all()


def test_edges_beneath_a_thin_box_do_not_show_on_its_top(shapes):
    box = shapes.quads(*shapes.box_sides((0, 0, 0), (1, 0.01, 1)))
    wall = np.array([[0.5, -0.2, 0.2], [0.5, -0.2, 0.8], [0.5, 0.0, 0.8], [0.5, 0.0, 0.2]])
    rib = shapes.flat((wall, np.array([1.0, 0.0, 0.0])), (wall, np.array([-1.0, 0.0, 0.0])))
    place = np.array([[0.5, 0.01, 0.8], [0.5, 0.01, 0.5], [0.5, 0.0, 0.8], [0.5, 0.0, 0.5]])
    sides = np.array([UP, UP, -UP, -UP])
    found = edge_distances(joined(box, rib), place, sides, REACH)
    np.testing.assert_allclose(found.convex, [0.2, REACH, 0.2, REACH])
    assert (stacked(found)[1:] == REACH).all()


def test_a_fine_sphere_and_a_cylinder_of_twelve_sides_have_no_edges_along(shapes):
    assert counts(shapes.sphere(2.0)) == (0, 0, 0)
    tube = trimesh.creation.cylinder(1.0, 2.0, sections=12)
    normals = tube.face_normals.repeat(3, axis=0)
    around = shapes.make_surface(
        tube.vertices[tube.faces].reshape(-1, 3), normals, np.arange(len(normals)).reshape(-1, 3)
    )
    assert counts(around) == (24, 0, 0)


def test_hidden_parts_have_no_edges(shapes):
    panel, inner = shapes.flat(shapes.floor()), shapes.flat(shapes.floor(-0.1))
    pair = replace(
        joined(panel, inner),
        face_part=np.array([0, 0, 1, 1]),
        parts=(Part("body"), Part("body (hidden)", hidden_half_of="body")),
    )
    assert counts(pair) == (0, 0, 4)


def test_moving_and_turning_the_model_changes_nothing(car):
    position, normal = scatter(car, 0.1)
    turn, offset = Rotation.from_euler("xyz", [20, 50, -70], degrees=True), np.array([30.0, -5.0, 8.0])
    here = stacked(edge_distances(car, position, normal, 0.1))
    there = edge_distances(moved(car, turn, offset), turn.apply(position) + offset, turn.apply(normal), 0.1)
    assert (here < 0.1).any(axis=1)[:2].all()
    np.testing.assert_allclose(stacked(there), here, atol=1e-9)


def test_distances_scale_with_the_model(car):
    position, normal = scatter(car, 0.1)
    here = stacked(edge_distances(car, position, normal, 0.1))
    large = moved(car, Rotation.identity(), np.zeros(3), 7.0)
    np.testing.assert_allclose(stacked(edge_distances(large, 7.0 * position, normal, 0.7)), 7.0 * here, atol=1e-9)


def test_batches_equal_the_whole_and_repeat_bit_by_bit(car):
    position, normal = scatter(car, 0.05)
    found = SharpEdges.of(car)
    whole = stacked(found.distances(position, normal, 0.1))
    cuts = [0, 1, 700, len(position)]
    batches = [stacked(found.distances(position[a:b], normal[a:b], 0.1)) for a, b in itertools.pairwise(cuts)]
    assert np.array_equal(np.concatenate(batches, axis=1), whole)
    assert np.array_equal(stacked(edge_distances(car, position, normal, 0.1)), whole)


def test_no_points_have_no_distances(car):
    assert stacked(edge_distances(car, np.zeros((0, 3)), np.zeros((0, 3)), 0.1)).shape == (3, 0)


def test_faces_without_area_have_no_edges(shapes):
    line = shapes.make_surface([[0, 0, 0], [1, 0, 0], [2, 0, 0]], np.tile(UP, (3, 1)), [[0, 1, 2], [0, 0, 1]])
    point = shapes.make_surface(np.zeros((3, 3)), np.tile(UP, (3, 1)), [[0, 1, 2]])
    assert counts(line) == counts(point) == (0, 0, 0)


def test_few_samples_and_few_neighbours_find_the_same(car, monkeypatch):
    position, normal = scatter(car, 0.1)
    exact = stacked(edge_distances(car, position, normal, 0.1))
    monkeypatch.setattr(edges, "_MOST_SAMPLES", 500)
    monkeypatch.setattr(edges, "_FEWEST", 1)
    found = SharpEdges.of(car)
    assert found.convex.spacing > 0.05
    np.testing.assert_allclose(stacked(found.distances(position, normal, 0.1)), exact, atol=1e-12)


def test_distances_are_those_to_every_edge_in_turn(car):
    position, normal = scatter(car, 0.3)
    found = SharpEdges.of(car)
    ends = found.convex.start[None], found.convex.along[None]
    offset = position[:, None] - ends[0]
    share = np.clip((offset * ends[1]).sum(axis=2) / (ends[1] ** 2).sum(axis=2), 0.0, 1.0)
    gap = np.linalg.norm(offset - share[..., None] * ends[1], axis=2)
    agree = np.einsum("esi,pi->pes", found.convex.sides, normal).max(axis=2) > 0.3
    expected = np.where(agree, gap, 0.2).min(axis=1).clip(max=0.2)
    np.testing.assert_allclose(found.distances(position, normal, 0.2).convex, expected, atol=1e-12)
