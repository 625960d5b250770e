"""What a generator paints reaches every point of a mesh, whatever the embedding hides."""

from __future__ import annotations

import gc
import weakref
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
import trimesh
from torch import Tensor

from svbrdfgan.asset.peels import peels
from svbrdfgan.asset.points import SurfacePoints
from svbrdfgan.asset.surroundings import Surroundings
from svbrdfgan.geometry.layers import embed_and_rasterize
from svbrdfgan.geometry.tangents import corner_tangents
from svbrdfgan.inference.embedded_peels import EmbeddedPeels
from svbrdfgan.inference.learned import LearnedWeathering
from svbrdfgan.inference.learned_painter import LearnedPainter
from svbrdfgan.inference.peel_layers import mesh_map_inputs
from svbrdfgan.inference.workpiece import Workpiece, open_workpiece
from svbrdfgan.io.gltf.surface_files import save_mesh_glb
from svbrdfgan.plugins.registry import load_embedding
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.vehicle import build_vehicle
from svbrdfgan.types import Mesh, Part, channel_slices
from svbrdfgan.weathering.mesh_maps import bake_mesh_maps
from svbrdfgan.weathering.recipes import ChippedPaint, Recipe, RoadDirt, Rust
from svbrdfgan.weathering.recipes.smooth import SmoothDirt
from svbrdfgan.weathering.substances import Substance

TEXELS = 128


def paint_position(geometry: Tensor, factor: int, wanted: Tensor) -> Tensor:
    """The layer whose colour is where the surface is, in the network's coordinates; flat, and of roughness 0.5."""
    position = geometry[:, :3].permute(0, 2, 3, 1)
    fine = position.repeat_interleave(factor, dim=1).repeat_interleave(factor, dim=2)
    rest = torch.tensor([1.0, 0.5, 0.0, 0.0, 1.0]).expand(*fine.shape[:3], 5)
    return torch.cat([fine, rest], dim=-1)


def position_model() -> LearnedWeathering:
    maps = ("roughness", "normal")
    generator = SimpleNamespace(mesh_maps=False, maps=maps, channels=channel_slices(maps))
    embedding = SimpleNamespace(name="hemispherical", options={})
    dataset = SimpleNamespace(texture=TEXELS, embedding=embedding, maps=dict.fromkeys(maps, 0.0))
    model = SimpleNamespace(generator=generator, config=SimpleNamespace(dataset=dataset), geometry_texels=TEXELS)
    return LearnedWeathering(model, paint_position, {})  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def workpiece(tmp_path_factory: pytest.TempPathFactory) -> Workpiece:
    path = tmp_path_factory.mktemp("van") / "van.glb"
    save_mesh_glb(path, build_vehicle(sample_vehicle("van", 5)))
    return open_workpiece(path, learnable=("*",), front="+Z", up="+Y")


@pytest.fixture(scope="module")
def painter(workpiece: Workpiece) -> LearnedPainter:
    found = position_model().painter(workpiece)
    assert isinstance(found, LearnedPainter)
    return found


def points_on(workpiece: Workpiece, count: int) -> SurfacePoints:
    corners = workpiece.mesh.positions[workpiece.mesh.faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    rng = np.random.default_rng(1)
    return SurfacePoints(rng.choice(len(area), count, p=area / area.sum()), rng.dirichlet(np.ones(3), count))


def painted_positions(workpiece: Workpiece, color: np.ndarray) -> np.ndarray:
    low, high = workpiece.mesh.bounds
    ground = np.array([(low[0] + high[0]) / 2, low[1], (low[2] + high[2]) / 2])
    return color * (high - low)[[0, 2]].max() / 2 + ground


def test_every_point_gets_what_was_painted_where_it_is(workpiece: Workpiece, painter: LearnedPainter) -> None:
    points = points_on(workpiece, 40_000)
    paint = painter(points, 0.01)
    where = painted_positions(workpiece, paint.color)
    off = np.linalg.norm(where - points.positions(workpiece.mesh), axis=1) / np.ptp(workpiece.mesh.positions[:, 2])
    assert np.median(off) < 1e-3
    assert np.quantile(off, 0.99) < 0.02
    np.testing.assert_allclose(paint.alpha, 1.0, atol=1e-3)
    np.testing.assert_allclose(paint.roughness, 0.5, atol=1e-3)


def test_a_flat_normal_is_the_surface_s_own(workpiece: Workpiece, painter: LearnedPainter) -> None:
    points = points_on(workpiece, 1000)
    at = painter.embedded.subfaces.find(points)
    normal = painter(points, 0.01).normal
    assert normal is not None
    own = at.interpolate(painter.embedded.surface.normals[painter.embedded.surface.faces])
    np.testing.assert_allclose((normal * own / np.linalg.norm(own, axis=1, keepdims=True)).sum(axis=1), 1.0, atol=1e-3)


def test_normals_lean_as_the_layer_s_do_in_the_frames_of_the_embedding(workpiece: Workpiece) -> None:
    def lean_along_u(geometry: Tensor, factor: int, wanted: Tensor) -> Tensor:
        layer = paint_position(geometry, factor, wanted)
        layer[..., -3:] = torch.tensor([0.6, 0.0, 0.8])
        return layer

    painter = replace(position_model(), draw=lean_along_u).painter(workpiece)  # type: ignore[arg-type]
    assert isinstance(painter, LearnedPainter)
    points = points_on(workpiece, 2000)
    at = painter.embedded.subfaces.find(points)
    normal = painter(points, 0.01).normal
    assert normal is not None
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1.0, atol=1e-6)
    own = at.interpolate(painter.embedded.surface.normals[painter.embedded.surface.faces])
    rise = (normal * own / np.linalg.norm(own, axis=1, keepdims=True)).sum(axis=1)
    along = at.interpolate(corner_tangents(painter.embedded.surface).direction)
    lean = (normal * along / np.linalg.norm(along, axis=1, keepdims=True)).sum(axis=1)
    assert np.median(rise) == pytest.approx(0.8, abs=0.01)
    assert np.median(lean) == pytest.approx(0.6, abs=0.02)


def test_a_workpiece_is_embedded_once_for_all_draws_of_a_model_and_forgotten_with_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    embedded: list[int] = []

    def count(*arguments: Any) -> EmbeddedPeels:
        embedded.append(arguments[2])
        return found(*arguments)

    found = EmbeddedPeels.of
    monkeypatch.setattr(EmbeddedPeels, "of", count)
    save_mesh_glb(tmp_path / "van.glb", build_vehicle(sample_vehicle("van", 6)))
    workpiece = open_workpiece(tmp_path / "van.glb", learnable=("*",), front="+Z", up="+Y")
    first, second = (position_model(), replace(position_model(), resolution=2 * TEXELS))
    painters = [each.painter(workpiece) for each in (first, second, first)]
    assert embedded == [TEXELS]
    other = position_model()
    other.model.config.dataset.texture = other.model.geometry_texels = TEXELS // 2  # type: ignore[misc]  # a stand-in
    painters.append(other.painter(workpiece))
    assert embedded == [TEXELS, TEXELS // 2]
    kept = weakref.ref(painters[-1].embedded)  # type: ignore[attr-defined]
    del painters, workpiece
    gc.collect()
    assert kept() is None


def test_peels_have_the_mesh_maps_of_what_they_show(workpiece: Workpiece) -> None:
    fragments = embed_and_rasterize(load_embedding("hemispherical", {}), workpiece.mesh, TEXELS)
    surface, everything = fragments.surface, np.ones(len(workpiece.mesh.faces), bool)
    found = list(peels(fragments, everything, workpiece.surroundings.reversed))
    inputs = mesh_map_inputs(surface, found, workpiece.surroundings)
    wanted = bake_mesh_maps(surface, found[0].buffer).network_input()
    torch.testing.assert_close(inputs[0], wanted)
    assert len(found) > 1
    for peel, given in zip(found[1:], inputs[1:], strict=True):
        exact, known = bake_mesh_maps(surface, peel.buffer).network_input(), torch.from_numpy(peel.known)
        torch.testing.assert_close(given[2:, known], exact[2:, known])
        assert (given[:2, known] - exact[:2, known]).abs().median() < 0.03
        assert torch.equal(given[:, ~known], inputs[0][:, ~known])


def test_what_is_enclosed_is_not_seen() -> None:
    boxes = [trimesh.creation.box((size, size, size)) for size in (1.0, 0.5)]
    corners, faces = (np.concatenate(parts) for parts in zip(*((b.vertices, b.faces) for b in boxes), strict=True))
    faces[12:] += 8
    mesh = Mesh(corners, faces, np.zeros(24, np.int64), (Part("box"),))
    assert Surroundings.of(mesh).seen().tolist() == 12 * [True] + 12 * [False]


@pytest.mark.parametrize("recipe", [RoadDirt, Rust, SmoothDirt])
def test_a_layer_lies_on_what_its_recipe_settles_on(recipe: type[Recipe], workpiece: Workpiece) -> None:
    learned = replace(position_model(), recipe=recipe)
    opened = open_workpiece(workpiece.asset.path, front="+Z", up="+Y")
    workpiece = opened.settled(learned.settles_on)
    assert (len(workpiece.weathered) > len(opened.weathered)) == (recipe is RoadDirt)  # on glass, too
    points = points_on(workpiece, 20_000)
    paint = learned.painter(workpiece)(points, 0.01)
    substance = workpiece.surroundings.substance[points.face]
    assert {Substance.PAINT, Substance.GLASS, Substance.RUBBER} <= set(substance)
    for kind in np.unique(substance):
        share = recipe.settles_on.get(Substance(kind), 0.0) if recipe.settles_on else 1.0
        np.testing.assert_allclose(paint.alpha[substance == kind], share, atol=1e-3)


@pytest.mark.parametrize(
    ("recipe", "maps"),
    [
        (RoadDirt, ["roughness", "normal", "metallic"]),
        (ChippedPaint, ["roughness", "normal"]),
        (None, ["roughness", "normal"]),
    ],
)
def test_what_is_no_metal_hides_metal(recipe: type[Recipe] | None, maps: list[str], workpiece: Workpiece) -> None:
    painter = replace(position_model(), recipe=recipe).painter(workpiece)
    assert list(painter.maps) == maps
    assert not painter(points_on(workpiece, 100), 0.01).metallic.any()
