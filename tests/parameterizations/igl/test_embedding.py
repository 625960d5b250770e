"""Wraps of meshes that are no surface, and what is carried to them."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from svbrdfgan_igl import LscmEmbedding, StretchEmbedding
from svbrdfgan_igl.chart import Chart
from svbrdfgan_igl.energy import RestTriangles, stretch
from svbrdfgan_igl.flatten import one_to_one

from svbrdfgan.errors import ConfigError, EmbeddingError
from svbrdfgan.geometry.layers import hide_inner_layers
from svbrdfgan.geometry.normals import face_areas
from svbrdfgan.io.mesh import load_mesh
from svbrdfgan.metrics.uv.distortion import distortion
from svbrdfgan.metrics.uv.visibility import visible_surface, whole_surface
from svbrdfgan.protocols import UVEmbedding
from svbrdfgan.types import Mesh, Part, Surface

EITHER = pytest.mark.parametrize("make", [StretchEmbedding, LscmEmbedding])


def soup(*shapes: trimesh.Trimesh) -> Mesh:
    joined = trimesh.util.concatenate(list(shapes))
    faces = np.asarray(joined.faces, dtype=np.int64)
    return Mesh(np.asarray(joined.vertices), faces, np.zeros(len(faces), np.int64), (Part("paint"),))


def box(size: tuple[float, float, float], at: tuple[float, float, float]) -> trimesh.Trimesh:
    shape = trimesh.creation.box(extents=size)
    shape.apply_translation(at)
    return shape


CELLS = 32


@pytest.fixture(scope="session")
def car() -> Mesh:
    """A body and a cabin that intersect, four wheels, and a seat inside."""
    wheels = [box((0.2, 0.5, 0.6), (x, 0.25, z)) for x in (-0.8, 0.8) for z in (-1.2, 1.2)]
    body, cabin = box((1.7, 0.6, 4.0), (0, 0.6, 0)), box((1.4, 0.6, 1.8), (0, 1.1, -0.3))
    return soup(body, cabin, box((0.5, 0.5, 0.5), (0, 0.6, 0)), *wheels)


@pytest.fixture(scope="session")
def least(car: Mesh) -> Chart:
    return StretchEmbedding(cells=CELLS).chart(car)


@pytest.fixture(scope="session")
def angle(car: Mesh) -> Chart:
    return LscmEmbedding(cells=CELLS).chart(car)


@pytest.fixture(scope="session")
def surface(car: Mesh) -> Surface:
    return StretchEmbedding(cells=CELLS).embed(car)


def test_are_embeddings() -> None:
    assert isinstance(StretchEmbedding(), UVEmbedding)
    assert isinstance(LscmEmbedding(), UVEmbedding)


@pytest.mark.parametrize("name", ["least", "angle"])
def test_a_wrap_is_a_disk_close_to_the_mesh_and_one_to_one(name: str, request: pytest.FixtureRequest) -> None:
    chart: Chart = request.getfixturevalue(name)
    assert chart.is_wrap
    assert chart.disk.is_disk
    assert one_to_one(chart.disk, chart.uv)
    assert chart.uv.min() >= 1 / 256 - 1e-9
    assert chart.uv.max() <= 1 - 1 / 256 + 1e-9
    roof = chart.disk.positions[:, 1].max() * chart.frame.size + chart.frame.low[1]
    assert roof == pytest.approx(1.4, abs=4.0 / CELLS)


def test_the_wrap_of_a_car_meets_the_numbers_of_the_issue(least: Chart, angle: Chart) -> None:
    stretches = [stretch(chart.disk.positions, chart.disk.faces, chart.uv) for chart in (least, angle)]
    assert stretches[0] <= min(1.10, stretches[1])
    triangles = RestTriangles.of(least.disk.positions, least.disk.faces)
    assert (triangles.area * triangles.determinants(least.uv)).sum() >= 0.75


@pytest.mark.full
def test_every_place_of_the_outside_lies_where_the_wrap_puts_it(surface: Surface) -> None:
    corners = surface.positions[surface.faces].mean(axis=1)
    uv = surface.uv[surface.faces].mean(axis=1)
    bonnet = (np.abs(corners[:, 1] - 0.9) < 1e-6) & (corners[:, 2] > 1.0) & (np.abs(corners[:, 0]) < 0.5)
    tail = (np.abs(corners[:, 1] - 0.9) < 1e-6) & (corners[:, 2] < -1.5) & (np.abs(corners[:, 0]) < 0.5)
    right, left = corners[:, 0] == -0.85, corners[:, 0] == 0.85
    assert uv[bonnet, 1].max() < 0.5 < uv[tail, 1].min()
    assert uv[right, 0].max() < 0.4 < 0.6 < uv[left, 0].min()


def test_what_is_inside_lies_lower(surface: Surface) -> None:
    height = surface.elevation[surface.faces].mean(axis=1)
    seat = (surface.source_face >= 24) & (surface.source_face < 36)
    roof = np.abs(surface.positions[surface.faces][:, :, 1] - 1.4).max(axis=1) < 1e-6
    assert height[seat].max() < -0.05
    assert np.abs(height[roof]).max() < 0.15


def test_no_piece_joins_places_far_apart(surface: Surface) -> None:
    """Also underneath, where one half is nearest to the right side and the other to the left."""
    assert np.ptp(surface.uv[surface.faces], axis=1).max() < 0.5


def test_upright_walls_are_not_lines(car: Mesh, surface: Surface) -> None:
    """Nearly all of body and cabin, near the wrap, has more than a quarter of its fair share of the square."""
    area = face_areas(surface.positions, surface.faces)
    flat = face_areas(np.column_stack([surface.uv, np.zeros(len(surface.uv))]), surface.faces)
    height = surface.elevation[surface.faces].mean(axis=1)
    shell = (surface.source_face < 24) & (height > -0.1)
    share = (flat / area)[shell] * area[shell].sum() / flat[shell].sum()
    assert (area[shell] * (share < 0.25)).sum() < 0.005 * area[shell].sum()


@pytest.mark.parametrize("where", ["whole", "outside"])
def test_no_piece_is_collapsed(where: str, surface: Surface) -> None:
    """One sliver with a singular value of zero would make the L2 stretch of the whole infinite."""
    found = whole_surface(surface) if where == "whole" else visible_surface(hide_inner_layers(surface, 256))
    assert distortion(found).stretch_l2 < 1.3


def test_all_lies_in_the_square(surface: Surface) -> None:
    assert surface.uv.min() >= 1 / 256 - 1e-9
    assert surface.uv.max() <= 1 - 1 / 256 + 1e-9


@EITHER
def test_a_surface_too_thin_to_be_spread_out_is_refused(make: type[StretchEmbedding]) -> None:
    rod = trimesh.creation.cylinder(radius=0.02, height=10.0, sections=6).subdivide_to_size(0.1)
    with pytest.raises(EmbeddingError, match="too thin and long"):
        make(seams=0).embed(soup(rod))


def test_a_mesh_that_is_a_surface_is_spread_out_itself() -> None:
    shape = trimesh.creation.icosphere(subdivisions=2)
    mesh = soup(shape)
    surface = StretchEmbedding().embed(mesh)
    assert len(surface.faces) == len(mesh.faces)
    assert not surface.elevation.any()
    uv = surface.uv[surface.faces]
    assert (np.linalg.det(np.stack([uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]], axis=1)) > 0).all()


@pytest.mark.full
def test_seams_cut_a_wrap_too(car: Mesh) -> None:
    whole, cut = (StretchEmbedding(cells=16, seams=n).chart(car) for n in (0, 2))
    assert len(cut.disk.border) > len(whole.disk.border)
    assert cut.disk.is_disk


@pytest.mark.parametrize(
    "options",
    [{"resolution": 0}, {"boundary": "round"}, {"seams": -1}, {"gutter": float("nan")}, {"gutter": 99.0}, {"cells": 1}],
)
@EITHER
def test_impossible_options_are_refused(make: type[StretchEmbedding], options: dict) -> None:
    with pytest.raises(ConfigError, match=next(iter(options))):
        make(**options)


def test_a_point_is_refused() -> None:
    with pytest.raises(EmbeddingError, match="size"):
        StretchEmbedding().embed(Mesh(np.ones((3, 3)), np.array([[0, 1, 2]]), np.zeros(1, np.int64), (Part("paint"),)))


@pytest.mark.assets
@pytest.mark.slow
@EITHER
def test_every_real_vehicle_embeds(assets: Path, make: type[StretchEmbedding]) -> None:
    for path in sorted((assets / "cars").glob("*.glb")):
        chart = make().chart(load_mesh(path))
        assert one_to_one(chart.disk, chart.uv), path.name
