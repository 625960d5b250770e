"""Materials of files over another UV: roughness, metallic and alpha looked up, normals turned into the other frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from svbrdfgan_hemispherical import HemisphericalEmbedding

from svbrdfgan.geometry.bake_materials import bake_base_color, bake_file_maps
from svbrdfgan.geometry.layers import embed_and_rasterize
from svbrdfgan.geometry.normals import unit
from svbrdfgan.geometry.rasterize import Fragments
from svbrdfgan.geometry.tangents import corner_tangents
from svbrdfgan.io.mesh import load_mesh
from svbrdfgan.testing import scenes
from svbrdfgan.types import FileMap, Mesh, Part, Surface

Matrix = list[list[float]]
TILTED = np.array([0.48, 0.36, 0.8])
STRAIGHT, TURNED, MIRRORED, SHEARED = (
    [[1.0, 0.0], [0.0, 1.0]],
    [[0.6, 0.8], [-0.8, 0.6]],
    [[-1.0, 0.0], [0.0, 1.0]],
    [[1.0, 0.7], [0.0, 0.5]],
)


def with_uv(surface: Surface, matrix: Matrix) -> Surface:
    return replace(surface, uv=(surface.positions[:, :2]) @ np.array(matrix).T / 2 + 0.5)


def sheet(
    own: Matrix, new: Matrix, maps: Mapping[str, FileMap], further: Matrix = STRAIGHT, color: np.ndarray | None = None
) -> tuple[Mesh, Fragments]:
    """A square in the XY plane with two sets of UVs of its own, and the same one over other UVs, rasterised.

    The texture of its base colour is over the second set.
    """
    part = Part("sheet", (1.0, 1.0, 1.0), color, file_maps=maps, texture_uv_set=1)
    surface = replace(with_uv(scenes.plane(1.0), new), parts=(part,))
    first, second = (with_uv(scenes.plane(1.0), matrix).uv[surface.faces] for matrix in (own, further))
    mesh = Mesh(surface.positions, surface.faces, surface.face_part, (part,), first, (second,))
    return mesh, Fragments.of(surface, 16, 16)


def flat(value: np.ndarray, factor: tuple[float, ...] = (1.0, 1.0, 1.0)) -> FileMap:
    return FileMap(factor, np.tile(value.astype(np.float32), (2, 3, 1)))


def frame(matrix: Matrix) -> np.ndarray:
    """Tangent, bitangent and normal as rows, by hand: u grows along the first column of the inverse."""
    along = np.linalg.inv(np.array(matrix))[:, 0]
    tangent = np.array([*along, 0.0]) / np.linalg.norm(along)
    bitangent = np.sign(np.linalg.det(matrix)) * np.cross([0.0, 0.0, 1.0], tangent)
    return np.stack([tangent, bitangent, [0.0, 0.0, 1.0]])


@pytest.mark.parametrize("own", [STRAIGHT, TURNED, MIRRORED, SHEARED])
@pytest.mark.parametrize("new", [STRAIGHT, TURNED, MIRRORED, SHEARED])
def test_a_tilt_keeps_its_direction_in_space(own: Matrix, new: Matrix) -> None:
    (maps,) = bake_file_maps(*sheet(own, new, {"normal": flat(TILTED)}))
    there = maps["normal"].double().numpy() @ frame(new)
    np.testing.assert_allclose(there, np.broadcast_to(TILTED @ frame(own), there.shape), atol=1e-6)


@pytest.mark.parametrize("own", [TURNED, MIRRORED, SHEARED])
def test_a_tilt_keeps_the_direction_that_its_own_uv_give_it(own: Matrix) -> None:
    """The mesh's first UVs, which are straight, do not count for a texture over others."""
    mesh, fragments = sheet(STRAIGHT, STRAIGHT, {"normal": replace(flat(TILTED), uv_set=1)}, further=own)
    (maps,) = bake_file_maps(mesh, fragments)
    there = maps["normal"].double().numpy()
    np.testing.assert_allclose(there, np.broadcast_to(TILTED @ frame(own), there.shape), atol=1e-6)


def test_textures_are_looked_up_at_their_own_uv() -> None:
    ramp = ((np.arange(32) + 0.5) / 32).astype(np.float32)[None, :, None]
    maps = {"roughness": FileMap((1.0,), ramp), "metallic": FileMap((1.0,), ramp, uv_set=1)}
    mesh, fragments = sheet(STRAIGHT, STRAIGHT, maps, further=MIRRORED, color=np.repeat(ramp, 3, axis=2))
    (baked,), (color,) = bake_file_maps(mesh, fragments), bake_base_color(mesh, fragments)
    inside = slice(1, -1)
    torch.testing.assert_close(baked["metallic"][:, inside], 1.0 - baked["roughness"][:, inside])
    torch.testing.assert_close(color, baked["metallic"].expand(-1, -1, 3))


def test_a_normal_s_scale_counts_before_its_length_is_one() -> None:
    (maps,) = bake_file_maps(*sheet(STRAIGHT, STRAIGHT, {"normal": flat(2 * TILTED, (0.5, 0.5, 1.0))}))
    expected = torch.from_numpy(TILTED * [0.5, 0.5, 1.0] / np.linalg.norm(TILTED * [0.5, 0.5, 1.0])).float()
    torch.testing.assert_close(maps["normal"], expected.expand(16, 16, 3))


def test_textures_are_looked_up_and_constants_stay() -> None:
    ramp = ((np.arange(32) + 0.5) / 32).astype(np.float32)[None, :, None]
    maps = {"roughness": FileMap((0.5,), ramp), "metallic": FileMap((0.25,)), "alpha": FileMap((0.9,), ramp)}
    (baked,) = bake_file_maps(*sheet(STRAIGHT, TURNED, maps))
    uv = np.stack(np.meshgrid(*[(np.arange(16) + 0.5) / 16] * 2), axis=-1)
    x = ((uv - 0.5) * 2 @ np.linalg.inv(TURNED).T)[..., 0]
    inside = abs((uv - 0.5) * 2 @ np.linalg.inv(TURNED).T).max(axis=-1) < 0.5
    np.testing.assert_allclose(baked["roughness"][..., 0][inside], 0.5 * (x[inside] / 2 + 0.5), atol=1e-6)
    torch.testing.assert_close(baked["alpha"], 1.8 * baked["roughness"])
    assert torch.equal(baked["metallic"], torch.tensor([0.25]))


def test_a_mask_cuts_after_the_lookup() -> None:
    """On a ramp, where the product with the factor falls below it: not at a border of the file's texels."""
    ramp = np.array([0.0, 1.0], np.float32)[None, :, None]
    (maps,) = bake_file_maps(*sheet(STRAIGHT, STRAIGHT, {"alpha": FileMap((0.8,), ramp, cutoff=0.5)}))
    u = (np.arange(16) + 0.5) / 16
    share = np.clip(2 * u - 0.5, 0, 1)
    expected = torch.from_numpy(0.8 * share >= 0.5).float()
    assert torch.equal(maps["alpha"][8, 4:12, 0], expected[4:12])
    assert torch.equal(
        bake_file_maps(*sheet(STRAIGHT, STRAIGHT, {"alpha": FileMap((0.4,), cutoff=0.5)}))[0]["alpha"], torch.zeros(1)
    )


def test_a_part_that_covers_no_texel_has_the_mean() -> None:
    ramp = np.linspace(0, 1, 4, dtype=np.float32)[None, :, None]
    mesh, fragments = sheet(STRAIGHT, STRAIGHT, {"roughness": FileMap((0.5,), ramp), "normal": flat(TILTED)})
    small = replace(fragments.surface, uv=np.full_like(fragments.surface.uv, 0.5))
    (maps,) = bake_file_maps(mesh, Fragments.of(small, 16, 16))
    torch.testing.assert_close(maps["roughness"], torch.tensor([0.25]))
    torch.testing.assert_close(maps["normal"], torch.tensor([0.0, 0.0, 1.0]))


def test_what_a_file_does_not_say_is_not_there() -> None:
    assert bake_file_maps(*sheet(STRAIGHT, STRAIGHT, {})) == ({},)
    mesh, fragments = sheet(STRAIGHT, STRAIGHT, {"normal": flat(TILTED), "roughness": FileMap((0.5,))})
    (maps,) = bake_file_maps(replace(mesh, uv=None), fragments)
    assert maps.keys() == {"roughness"}


@pytest.mark.parametrize("name", ["spot_uv", "bob_uv"])
def test_on_a_real_mesh_relief_points_where_its_file_says(assets: Path, name: str) -> None:
    """At the middle of its faces, by tangents of the mesh's own UVs; nowhere is there room for another sign."""
    mesh = load_mesh(assets / "meshes" / f"{name}.obj")
    assert mesh.uv is not None
    parts = tuple(replace(part, file_maps={"normal": flat(TILTED)}) for part in mesh.parts)
    mesh = replace(mesh, parts=parts)
    fragments = embed_and_rasterize(HemisphericalEmbedding(resolution=64), mesh, 64)
    surface, new = fragments.surface, corner_tangents(fragments.surface)
    raster = fragments.outermost(surface.face_part == 0)
    baked = bake_file_maps(mesh, fragments)[0]["normal"].double().numpy()[raster.mask]
    face, barycentric = raster.face[raster.mask], raster.barycentric[raster.mask]
    normal = unit(np.einsum("nj,njk->nk", barycentric, surface.normals[surface.faces[face]]))
    tangent = np.einsum("nj,njk->nk", barycentric, new.direction[face])
    tangent = unit(tangent - (tangent * normal).sum(-1, keepdims=True) * normal)
    across = new.handedness[face][:, None] * np.cross(normal, tangent)
    there = baked[:, :1] * tangent + baked[:, 1:2] * across + baked[:, 2:] * normal
    np.testing.assert_allclose((there * normal).sum(-1), TILTED[2], atol=1e-5)
    # the file's own frame of each face, flat: dP/du from positions and UVs
    source = surface.source_face[face]
    edges = mesh.positions[mesh.faces[source]][:, 1:] - mesh.positions[mesh.faces[source]][:, :1]
    steps = mesh.uv[source][:, 1:] - mesh.uv[source][:, :1]
    jacobian = np.einsum("nij,njk->nik", np.linalg.inv(steps), edges)  # dP/du, dP/dv
    along = unit(jacobian[:, 0] - (jacobian[:, 0] * normal).sum(-1, keepdims=True) * normal)
    up = np.sign(np.linalg.det(steps))[:, None] * np.cross(normal, along)
    expected = TILTED[0] * along + TILTED[1] * up + TILTED[2] * normal
    cosine = (there * expected).sum(-1)
    assert np.median(cosine) > 0.998  # tangents are means over the faces at a vertex
    assert np.quantile(cosine, 0.02) > 0.9
