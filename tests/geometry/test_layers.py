"""Inner layers go to hidden parts; what lies on the outermost surface does not."""

import numpy as np
import trimesh
from svbrdfgan_hemispherical import HemisphericalEmbedding

from svbrdfgan.geometry.layers import hide_inner_layers
from svbrdfgan.geometry.normals import face_areas
from svbrdfgan.geometry.subdivide import unique_edges
from svbrdfgan.types import Mesh, Part


def domes(*radii: float) -> Mesh:
    """Half spheres over the ground, one inside another, each a part of its own."""
    ball = trimesh.creation.icosphere(subdivisions=2)
    faces = ball.faces[ball.vertices[ball.faces][:, :, 1].min(axis=1) > -1e-9]
    positions = np.concatenate([ball.vertices * r for r in radii])
    return Mesh(
        positions,
        np.concatenate([faces + i * len(ball.vertices) for i in range(len(radii))]),
        np.repeat(np.arange(len(radii)), len(faces)),
        tuple(Part(f"dome {i}") for i in range(len(radii))),
    )


def test_the_inner_dome_is_hidden_whole() -> None:
    surface = hide_inner_layers(HemisphericalEmbedding(resolution=32).embed(domes(1.0, 0.5)), 32)
    assert [(p.name, p.hidden_half_of, p.mesh_part) for p in surface.parts] == [
        ("dome 0", None, "dome 0"),
        ("dome 1", None, "dome 1"),
        ("dome 1 (hidden)", "dome 1", "dome 1"),
    ]
    assert set(np.unique(surface.face_part)) == {0, 2}


def test_layers_thinner_than_the_tolerance_stay() -> None:
    surface = hide_inner_layers(HemisphericalEmbedding(resolution=32).embed(domes(1.0, 0.99, 1.0)), 32)
    assert len(surface.parts) == 3


def test_cutting_partly_covered_faces_keeps_shape_and_sources() -> None:
    box = trimesh.creation.box(extents=(2, 1, 4), transform=trimesh.transformations.translation_matrix((0, 0.5, 0)))
    lid = trimesh.creation.box(extents=(1, 0.3, 1), transform=trimesh.transformations.translation_matrix((0, 1.5, 0)))
    both = trimesh.util.concatenate([box, lid])
    mesh = Mesh(
        np.asarray(both.vertices), np.asarray(both.faces), np.zeros(len(both.faces), np.int64), (Part("paint"),)
    )
    before = HemisphericalEmbedding(resolution=64).embed(mesh)
    surface = hide_inner_layers(before, 64)
    assert len(surface.faces) > len(before.faces)
    assert [part.name for part in surface.parts] == ["paint", "paint (hidden)"]
    corners = np.einsum("fij,fjx->fix", surface.source_barycentric, mesh.positions[mesh.faces[surface.source_face]])
    assert np.allclose(corners, surface.positions[surface.faces])
    area = np.bincount(surface.source_face, face_areas(surface.positions, surface.faces))
    assert np.allclose(area, face_areas(mesh.positions, mesh.faces))
    _, weld = np.unique(np.round(surface.positions, 9), axis=0, return_inverse=True)
    edges, face_edges = unique_edges(weld.reshape(-1)[surface.faces])
    assert (np.bincount(face_edges.ravel(), minlength=len(edges)) == 2).all()
