"""The geometry buffer of things whose geometry is known."""

from dataclasses import replace

import numpy as np
import pytest
import torch
import trimesh
from svbrdfgan_hemispherical import HemisphericalEmbedding

from svbrdfgan.geometry.bake import GeometryBuffer, bake
from svbrdfgan.geometry.bake_materials import bake_base_color
from svbrdfgan.geometry.layers import embed_and_rasterize
from svbrdfgan.geometry.normals import face_areas
from svbrdfgan.geometry.rasterize import Fragments
from svbrdfgan.types import Mesh, Part, Surface


@pytest.fixture(scope="module")
def mesh() -> Mesh:
    """Two half spheres over the ground of radius 1 (wound inward) and 0.5, with UVs of their own."""
    ball = trimesh.creation.icosphere(subdivisions=3)
    faces = np.asarray(ball.faces[ball.vertices[ball.faces][:, :, 1].min(axis=1) > -1e-9])
    positions = np.concatenate([ball.vertices, 0.5 * ball.vertices])
    both = np.concatenate([faces[:, ::-1], faces + len(ball.vertices)])
    texture = np.zeros((64, 64, 3))
    texture[..., 0] = ((np.arange(64) + 0.5) / 64)[None, :]
    texture[..., 1] = ((np.arange(64) + 0.5) / 64)[:, None]
    parts = (Part("outer", (0.5, 1.0, 1.0), texture), Part("inner", (0.1, 0.2, 0.3)))
    uv = 0.5 + 0.4 * positions[both][:, :, [0, 2]]
    return Mesh(positions, both, np.repeat([0, 1], len(faces)), parts, uv)


@pytest.fixture(scope="module")
def fragments(mesh: Mesh) -> Fragments:
    return embed_and_rasterize(HemisphericalEmbedding(resolution=64), mesh, 64)


@pytest.fixture(scope="module")
def surface(fragments: Fragments) -> Surface:
    return fragments.surface


@pytest.fixture(scope="module")
def buffer(fragments: Fragments) -> GeometryBuffer:
    return bake(fragments)


def test_the_outer_dome_is_seen_from_outside(buffer: GeometryBuffer) -> None:
    radius = buffer.position[buffer.mask].norm(dim=1)
    assert radius.min() > 0.98
    assert torch.unique(buffer.part).tolist() in ([0], [-1, 0])
    cosine = (buffer.normal * buffer.position).sum(dim=-1)[buffer.mask] / radius
    assert cosine.min() > 0.99


def test_areas_sum_to_the_exposed_surface(mesh: Mesh, buffer: GeometryBuffer) -> None:
    outer = face_areas(mesh.positions, mesh.faces[mesh.face_part == 0]).sum()
    assert buffer.area.sum().item() == pytest.approx(outer, rel=0.005)
    assert (buffer.area[~buffer.mask] == 0).all()


def test_texels_lead_back_to_the_surface(surface: Surface, buffer: GeometryBuffer) -> None:
    corners = torch.from_numpy(surface.positions[surface.faces]).float()[buffer.face]
    again = torch.einsum("rcj,rcjx->rcx", buffer.barycentric, corners)
    assert torch.allclose(again[buffer.mask], buffer.position[buffer.mask], atol=1e-6)


def test_gutters_are_filled_and_the_network_sees_minus_one_to_one(buffer: GeometryBuffer) -> None:
    assert torch.allclose(buffer.normal.norm(dim=-1), torch.ones(64, 64), atol=1e-5)
    seen = buffer.network_input()
    assert seen.shape == (6, 64, 64)
    assert seen.abs().max() <= 1.0 + 1e-6
    assert seen[1].min() >= 0


def test_size_and_place_do_not_reach_the_network(mesh: Mesh, buffer: GeometryBuffer) -> None:
    moved = replace(mesh, positions=mesh.positions * 4 + (10, 3, -7))
    other = bake(embed_and_rasterize(HemisphericalEmbedding(resolution=64), moved, 64))
    assert torch.allclose(other.network_input(), buffer.network_input(), atol=1e-4)


def test_the_meshs_own_texture_is_resampled(mesh: Mesh, fragments: Fragments, buffer: GeometryBuffer) -> None:
    base = bake_base_color(mesh, fragments)
    assert len(base) == len(fragments.surface.parts)
    own_uv = 0.5 + 0.4 * buffer.position[..., [0, 2]]
    assert torch.allclose(base[0][buffer.mask][:, 0], 0.5 * own_uv[buffer.mask][:, 0], atol=1e-3)
    assert torch.allclose(base[0][buffer.mask][:, 1], own_uv[buffer.mask][:, 1], atol=1e-3)
    assert torch.allclose(base[1], torch.tensor([0.1, 0.2, 0.3]))
