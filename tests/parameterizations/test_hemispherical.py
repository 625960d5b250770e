"""Equation 4.1, to half a texel everywhere, without seam or pole on the surface."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from svbrdfgan_hemispherical import HemisphericalEmbedding

from svbrdfgan.errors import ConfigError, EmbeddingError
from svbrdfgan.geometry.normals import face_areas
from svbrdfgan.io.mesh import load_mesh
from svbrdfgan.protocols import UVEmbedding
from svbrdfgan.types import Mesh, Part, Surface


def solid(shape: trimesh.Trimesh) -> Mesh:
    faces = np.asarray(shape.faces, dtype=np.int64)
    return Mesh(np.asarray(shape.vertices), faces, np.zeros(len(faces), np.int64), (Part("paint"),))


@pytest.fixture(scope="module")
def mesh() -> Mesh:
    return solid(trimesh.creation.box(extents=(2, 1.5, 4)))


@pytest.fixture(scope="module")
def surface(mesh: Mesh) -> Surface:
    return HemisphericalEmbedding(resolution=128).embed(mesh)


def formula(points: np.ndarray, centre: np.ndarray) -> np.ndarray:
    d = (points - centre) / np.linalg.norm(points - centre, axis=-1, keepdims=True)
    theta = np.arccos(-d[..., 0] / np.hypot(d[..., 0], d[..., 1]))  # from the vehicle's right, -X
    return np.stack([theta, np.arccos(d[..., 2])], axis=-1) / np.pi


CENTRE = np.array([0, -0.75 - 0.02 * 1.5, 0])


def test_is_an_embedding() -> None:
    assert isinstance(HemisphericalEmbedding(), UVEmbedding)


def test_vertices_have_the_angles_of_equation_4_1(surface: Surface) -> None:
    assert np.allclose(surface.uv, formula(surface.positions, CENTRE), atol=1e-9)
    assert np.allclose(surface.elevation, np.linalg.norm(surface.positions - CENTRE, axis=1))
    assert surface.uv.min() > 0
    assert surface.uv.max() < 1


def test_interpolation_errs_by_at_most_half_a_texel(surface: Surface) -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        weights = rng.dirichlet([0.7, 0.7, 0.7], len(surface.faces))
        point, uv = (np.einsum("fc,fcx->fx", weights, a[surface.faces]) for a in (surface.positions, surface.uv))
        assert np.linalg.norm(uv - formula(point, CENTRE), axis=1).max() * 128 <= 0.5


def test_shape_and_winding_are_the_meshs(mesh: Mesh, surface: Surface) -> None:
    corners = np.einsum("fij,fjx->fix", surface.source_barycentric, mesh.positions[mesh.faces[surface.source_face]])
    assert np.abs(corners - surface.positions[surface.faces]).max() < 1e-14
    area = np.bincount(surface.source_face, face_areas(surface.positions, surface.faces))
    assert np.allclose(area, face_areas(mesh.positions, mesh.faces))


def test_outer_faces_keep_their_winding_in_uv(surface: Surface) -> None:
    uv = surface.uv[surface.faces]
    top = surface.positions[surface.faces][:, :, 1].min(axis=1) > 0.7499
    assert top.any()
    assert (np.linalg.det(np.stack([uv[top, 1] - uv[top, 0], uv[top, 2] - uv[top, 0]], axis=1)) > 0).all()


def test_nose_roof_and_sides_lie_where_the_docstring_says(mesh: Mesh) -> None:
    frame = HemisphericalEmbedding().frame(mesh)
    nose, tail, roof, right, left = frame.uv(np.array([[0, 0, 2], [0, 0, -2], [0, 0.75, 0], [-1, 0, 0], [1, 0, 0.0]]))
    assert nose[1] < 0.2 < 0.8 < tail[1]
    assert np.allclose(roof, 0.5)
    assert right[0] < 0.3 < 0.7 < left[0]


@pytest.mark.parametrize("axis", ["x", "auto"])
def test_a_vehicle_turned_to_x_gets_the_same_map(mesh: Mesh, surface: Surface, axis: str) -> None:
    turned = Mesh(mesh.positions[:, [2, 1, 0]] * (1, 1, -1), mesh.faces, mesh.face_part, mesh.parts)
    other = HemisphericalEmbedding(resolution=128, axis=axis).embed(turned)  # type: ignore[arg-type]
    assert np.allclose(other.uv[other.faces], surface.uv[surface.faces])


@pytest.mark.parametrize("size", [1e-3, 1e3])
def test_size_does_not_matter(mesh: Mesh, surface: Surface, size: float) -> None:
    other = HemisphericalEmbedding(resolution=128).embed(
        Mesh(mesh.positions * size, mesh.faces, mesh.face_part, mesh.parts)
    )
    assert np.allclose(other.uv[other.faces], surface.uv[surface.faces])


@pytest.mark.parametrize(
    "options", [{"resolution": 0}, {"centre_height": 0.0}, {"centre_height": float("nan")}, {"axis": "y"}]
)
def test_impossible_options_are_refused(options: dict) -> None:
    with pytest.raises(ConfigError, match=next(iter(options))):
        HemisphericalEmbedding(**options)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_flat_meshes_are_refused(mesh: Mesh, axis: int) -> None:
    flattened = mesh.positions.copy()
    flattened[:, axis] = 0
    with pytest.raises(EmbeddingError, match="flat"):
        HemisphericalEmbedding().embed(Mesh(flattened, mesh.faces, mesh.face_part, mesh.parts))


@pytest.mark.assets
@pytest.mark.full
def test_every_real_vehicle_embeds(assets: Path) -> None:
    for path in sorted((assets / "cars").glob("*.glb")):
        surface = HemisphericalEmbedding(resolution=64).embed(load_mesh(path))
        assert surface.uv.min() > 0, path.name
        assert surface.uv.max() < 1, path.name
