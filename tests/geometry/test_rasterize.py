"""Texel centres: each on exactly one side of every shared edge, the outermost face on top."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from svbrdfgan.geometry import rasterize as module
from svbrdfgan.geometry.rasterize import Fragments, rasterize
from svbrdfgan.types import Part, Surface


def flat(
    uv: Float[ndarray, "n 2"], faces: Int[ndarray, "faces 3"], elevation: Float[ndarray, " n"] | None = None
) -> Surface:
    count = len(uv)
    return Surface(
        positions=np.column_stack([uv, np.zeros(count)]),
        normals=np.tile([0.0, 0.0, 1.0], (count, 1)),
        uv=uv,
        faces=faces,
        face_part=np.zeros(len(faces), dtype=np.int64),
        parts=(Part("paint"),),
        elevation=np.zeros(count) if elevation is None else elevation,
        source_face=np.arange(len(faces)),
        source_barycentric=np.tile(np.eye(3), (len(faces), 1, 1)),
    )


def grid(n: int, jitter: float, rng: np.random.Generator) -> Surface:
    v, u = np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, n + 1), indexing="ij")
    uv = np.stack([u, v], axis=-1)
    uv[1:-1, 1:-1] += rng.uniform(-jitter, jitter, uv[1:-1, 1:-1].shape) / n
    a = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    faces = np.concatenate([np.stack([a, a + 1, a + n + 2], 1), np.stack([a, a + n + 2, a + n + 1], 1)])
    flip = rng.random(len(faces)) < 0.5
    faces[flip] = faces[flip][:, ::-1]
    return flat(uv.reshape(-1, 2), faces)


def test_a_tiling_covers_every_texel_exactly_once() -> None:
    for n, jitter in ((8, 0.0), (16, 0.0), (7, 0.3)):  # 8 and 16 put edges and vertices on texel centres
        fragments = Fragments.of(grid(n, jitter, np.random.default_rng(n)), 12, 24)
        assert (fragments.layers == 1).all()


def test_coordinates_interpolate_to_texel_centres() -> None:
    surface = grid(5, 0.3, np.random.default_rng(0))
    uv = rasterize(surface, 10, 20).interpolate(surface.faces, surface.uv)
    v, u = np.meshgrid((np.arange(10) + 0.5) / 10, (np.arange(20) + 0.5) / 20, indexing="ij")
    assert np.allclose(uv, np.stack([u, v], axis=-1))


def test_the_outermost_wins_and_layers_are_counted() -> None:
    uv = np.array([[0, 0], [1, 0], [0, 1], [0, 0], [1, 0], [0, 1]], dtype=np.float64)
    surface = flat(uv, np.array([[3, 4, 5], [0, 1, 2], [0, 1, 2]]), np.array([2.0, 2, 2, 1, 1, 1]))
    fragments = Fragments.of(surface, 8, 8)
    assert set(np.unique(fragments.layers)) == {0, 3}
    first = np.array([True, False, False])
    for raster, below in (
        (rasterize(surface, 8, 8), rasterize(surface, 8, 8, only=first)),
        (fragments.outermost(), fragments.outermost(first)),
    ):
        assert set(np.unique(raster.face)) == {-1, 1}  # of equals the lowest index
        assert set(np.unique(below.face)) == {-1, 0}
        assert raster.face[0, 0] == 1
        assert raster.face[7, 7] == -1


def test_leaving_out_what_is_covered_changes_nothing(monkeypatch) -> None:  # type: ignore[no-untyped-def]
    rng = np.random.default_rng(3)
    count = 400
    corners = rng.uniform(-0.1, 0.3, (count, 3, 2)) + rng.random((count, 1, 2))
    elevation = np.repeat(rng.integers(0, 40, count), 3) + np.where(rng.random(3 * count) < 0.5, 0.0, 1.0)  # with ties
    surface = flat(corners.reshape(-1, 2), np.arange(3 * count).reshape(-1, 3), elevation)
    monkeypatch.setattr(module, "_CANDIDATES_AT_ONCE", 3000)
    found, wanted = rasterize(surface, 50, 70), Fragments.of(surface, 50, 70).outermost()
    assert (found.face == wanted.face).all()
    assert (found.elevation == wanted.elevation).all()
    assert (found.barycentric == wanted.barycentric).all()


def test_small_pieces_give_the_same_raster(monkeypatch) -> None:  # type: ignore[no-untyped-def]
    surface = grid(9, 0.3, np.random.default_rng(1))
    surface = replace(surface, elevation=np.random.default_rng(2).random(len(surface.uv)))
    whole, fragments = rasterize(surface, 32, 32), Fragments.of(surface, 32, 32)
    monkeypatch.setattr(module, "_CANDIDATES_AT_ONCE", 7)
    pieces = rasterize(surface, 32, 32)
    assert (whole.face == pieces.face).all()
    assert (whole.barycentric == pieces.barycentric).all()
    assert (fragments.texel == Fragments.of(surface, 32, 32).texel).all()


def test_triangles_without_area_in_uv_are_skipped() -> None:
    uv = np.array([[0.1, 0.1], [0.9, 0.9], [0.5, 0.5]])
    assert not rasterize(flat(uv, np.array([[0, 1, 2], [0, 0, 1]])), 8, 8).mask.any()
