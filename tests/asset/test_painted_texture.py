"""A painted texture is the same on any number of threads."""

from collections.abc import Iterator

import numpy as np
import pytest
import torch

from svbrdfgan.asset import painted_texture
from svbrdfgan.asset.painted_texture import ALPHA, Canvas, Model, paint_texture
from svbrdfgan.asset.painters import RecipePainter
from svbrdfgan.asset.points import SurfacePoints
from svbrdfgan.asset.surroundings import Surroundings
from svbrdfgan.asset.texture_bands import TILE
from svbrdfgan.geometry.normals import unit
from svbrdfgan.geometry.split import surface_over
from svbrdfgan.geometry.tangents import corner_tangents
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.vehicle import build_vehicle
from svbrdfgan.types import Mesh, Part
from svbrdfgan.weathering.recipes import Rust


@pytest.fixture
def restored_threads() -> Iterator[None]:
    before = torch.get_num_threads()
    yield
    torch.set_num_threads(before)


def test_threads_do_not_show(restored_threads: None) -> None:
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 0.5, 1], [0, 0.5, 1]], float)
    faces = np.array([[0, 2, 1], [0, 3, 2]])
    mesh = Mesh(corners, faces, np.zeros(2, np.int64), (Part("paint", (0.5, 0.5, 0.5)),))
    around = Surroundings.of(mesh)
    canvas = Canvas(Model(mesh, around.reversed), np.arange(2), corners[faces][..., [0, 2]])
    made = []
    for threads in (1, 3):
        torch.set_num_threads(threads)
        made.append(paint_texture(canvas, RecipePainter(around, Rust(amount=1.0)), 2 * TILE + 9, TILE))
    assert made[0][..., ALPHA].std() > 0.1
    np.testing.assert_array_equal(made[0], made[1])


def test_normals_of_the_whole_model_are_computed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tangent frames of some faces are those of a surface of all faces."""
    van = build_vehicle(sample_vehicle("van", 5))
    count, computed = len(van.faces), painted_texture.corner_normals
    calls: list[int] = []
    monkeypatch.setattr(
        painted_texture, "corner_normals", lambda points, faces: (calls.append(len(faces)), computed(points, faces))[1]
    )
    model, rng = Model(van, np.zeros(count, bool)), np.random.default_rng(0)
    for chosen in (np.arange(0, count, 3), np.arange(40, 80)):
        uv = rng.random((len(chosen), 3, 2))
        points = SurfacePoints(rng.permutation(chosen), rng.dirichlet([1.0, 1.0, 1.0], len(chosen)))
        normals = unit(rng.normal(size=(len(chosen), 3)))
        whole = np.zeros((count, 3, 2))
        whole[chosen] = uv
        surface = surface_over(van, whole)
        frames = corner_tangents(surface).frames(surface.normals[surface.faces], points.face, points.barycentric)
        wanted = np.stack([(normals * axis).sum(axis=1) for axis in frames], axis=1)
        np.testing.assert_allclose(Canvas(model, chosen, uv).in_tangent_space(points, normals), wanted, atol=1e-12)
    assert calls == [count]
