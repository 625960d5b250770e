"""What every kind of mesh file becomes."""

import logging
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from svbrdfgan.io.mesh import load_mesh
from svbrdfgan.types import Mesh

CORNER_COLORS = np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 0]]], dtype=np.uint8)
"""Top left red, top right green, bottom left blue, bottom right yellow."""


def area(mesh: Mesh) -> float:
    a, b, c = np.moveaxis(mesh.positions[mesh.faces], 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def volume(mesh: Mesh) -> float:
    a, b, c = np.moveaxis(mesh.positions[mesh.faces], 1, 0)
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def texel_at(mesh: Mesh, point: tuple[float, float, float]) -> np.ndarray:
    """The texture's nearest texel at the vertex that lies at `point`."""
    textured = np.array([part.texture is not None for part in mesh.parts])[mesh.face_part]
    found = np.all(np.isclose(mesh.positions[mesh.faces], point), axis=-1) & textured[:, None]
    face, corner = np.argwhere(found)[0]
    texture = mesh.parts[mesh.face_part[face]].texture
    assert texture is not None
    size = np.array(texture.shape[1::-1])
    assert mesh.uv is not None
    col, row = np.clip(np.floor(mesh.uv[face, corner] * size), 0, size - 1).astype(int)
    return texture[row, col]


TEXTURED = {"name": "wood", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
PICTURE = {"images": [{"uri": "corners.png"}], "textures": [{"source": 0}]}


@pytest.mark.parametrize("suffix", [".glb", ".gltf", ".obj", ".ply", ".stl"])
def test_a_closed_box_of_any_kind_is_closed_welded_and_outward(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"box{suffix}"
    trimesh.creation.box((1.0, 2.0, 3.0)).export(path)
    mesh = load_mesh(path)
    assert mesh.positions.shape == (8, 3)
    assert mesh.positions.dtype == np.float64
    assert mesh.faces.shape == (12, 3)
    assert mesh.faces.dtype == np.int64
    assert area(mesh) == pytest.approx(22.0)
    assert volume(mesh) == pytest.approx(6.0)  # positive: faces wind counter-clockwise seen from outside


def test_transforms_instances_and_mirrors_are_applied(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.creation.box(), geom_name="box", node_name="a")
    for node, matrix in {
        "moved": trimesh.transformations.translation_matrix([10, 0, 0]),
        "mirrored": np.diag([-2.0, 1.0, 1.0, 1.0]) @ trimesh.transformations.translation_matrix([10, 0, 0]),
    }.items():
        scene.graph.update(frame_to=node, frame_from="world", geometry="box", matrix=matrix)
    scene.export(tmp_path / "three.glb")
    mesh = load_mesh(tmp_path / "three.glb")
    assert len(mesh.faces) == 36
    assert len(mesh.positions) == 24
    np.testing.assert_allclose(mesh.bounds, [[-21, -0.5, -0.5], [10.5, 0.5, 0.5]])
    assert volume(mesh) == pytest.approx(1 + 1 + 2)  # a mirrored box that kept its winding would count negative
    assert len(mesh.parts) == 1


def test_loading_twice_gives_the_same_arrays(tmp_path: Path) -> None:
    scene = trimesh.Scene([trimesh.creation.box(), trimesh.creation.icosphere(subdivisions=1)])
    scene.export(tmp_path / "two.glb")
    first, second = load_mesh(tmp_path / "two.glb"), load_mesh(tmp_path / "two.glb")
    np.testing.assert_array_equal(first.positions, second.positions)
    np.testing.assert_array_equal(first.faces, second.faces)
    assert first.parts == second.parts


def test_parts_of_one_name_and_material_are_one_and_namesakes_get_numbers(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    looks = [((255, 0, 0, 255), 0.5), ((255, 0, 0, 255), 0.5), ((0, 0, 255, 255), 0.5), ((255, 0, 0, 255), 0.25)]
    for index, (color, rough) in enumerate(looks):
        box = trimesh.creation.box()
        box.apply_translation((3.0 * index, 0, 0))
        material = trimesh.visual.material.PBRMaterial(name="paint", baseColorFactor=color, roughnessFactor=rough)
        box.visual = trimesh.visual.TextureVisuals(material=material)
        scene.add_geometry(box)
    scene.export(tmp_path / "paints.glb")
    mesh = load_mesh(tmp_path / "paints.glb")
    assert [part.name for part in mesh.parts] == ["paint", "paint_2", "paint_3"]
    assert [part.base_color for part in mesh.parts] == [(1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)]
    assert [part.file_maps["roughness"].factor for part in mesh.parts] == [(0.5,), (0.5,), (0.25,)]
    np.testing.assert_array_equal(np.bincount(mesh.face_part), [24, 12, 12])


def test_gltf_factors_keep_their_precision(tmp_path: Path, gltf_quad: Callable[..., Path]) -> None:
    material = {"name": "m", "pbrMetallicRoughness": {"baseColorFactor": [0.12345, 0.5004, 0.00021, 1.0]}}
    assert load_mesh(gltf_quad(tmp_path, material)).parts[0].base_color == (0.12345, 0.5004, 0.00021)


def test_a_gltf_texture_is_upright_and_linear(tmp_path: Path, gltf_quad: Callable[..., Path]) -> None:
    Image.fromarray(CORNER_COLORS // 255 * 188).save(tmp_path / "corners.png")
    mesh = load_mesh(gltf_quad(tmp_path, TEXTURED, PICTURE))
    half = ((188 / 255 + 0.055) / 1.055) ** 2.4  # about one half
    np.testing.assert_allclose(texel_at(mesh, (0, 1, 0)), [half, 0, 0], atol=1e-6)
    np.testing.assert_allclose(texel_at(mesh, (1, 1, 0)), [0, half, 0], atol=1e-6)
    np.testing.assert_allclose(texel_at(mesh, (0, 0, 0)), [0, 0, half], atol=1e-6)
    np.testing.assert_allclose(texel_at(mesh, (1, 0, 0)), [half, half, 0], atol=1e-6)
    assert mesh.parts[0].base_color == (1.0, 1.0, 1.0)


def test_an_obj_texture_is_upright_and_kd_linear(tmp_path: Path) -> None:
    Image.fromarray(CORNER_COLORS).save(tmp_path / "corners.png")
    (tmp_path / "quad.mtl").write_text(
        "newmtl wood\nKd 0.25 0.50004 1\nmap_Kd corners.png\nnewmtl iron\nKd 0.1 0.2 0.3\n"
    )
    (tmp_path / "quad.obj").write_text(
        "mtllib quad.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
        "usemtl wood\nf 1/1 2/2 3/3 4/4\nusemtl iron\nf 1 2 5\n"
    )
    mesh = load_mesh(tmp_path / "quad.obj")
    parts = {part.name: part for part in mesh.parts}
    assert parts["wood"].base_color == (0.25, 0.50004, 1.0)
    assert parts["iron"].base_color == (0.1, 0.2, 0.3)
    assert parts["iron"].texture is None
    wood = mesh.face_part == [part.name for part in mesh.parts].index("wood")
    assert wood.sum() == 2
    assert mesh.uv is not None
    assert np.all(mesh.uv[~wood] == 0)  # the face that has none
    np.testing.assert_allclose(texel_at(mesh, (0, 1, 0)), [1, 0, 0])
    np.testing.assert_allclose(texel_at(mesh, (1, 1, 0)), [0, 1, 0])
    np.testing.assert_allclose(texel_at(mesh, (1, 0, 0)), [1, 1, 0])
    assert len(mesh.positions) == 5


@pytest.mark.parametrize("content", [None, b"not a picture", b"cut"])
def test_a_missing_or_broken_texture_is_a_warning(
    tmp_path: Path, gltf_quad: Callable[..., Path], caplog: pytest.LogCaptureFixture, content: bytes | None
) -> None:
    if content is not None:
        Image.fromarray(CORNER_COLORS).save(tmp_path / "corners.png")
        whole = (tmp_path / "corners.png").read_bytes()
        (tmp_path / "corners.png").write_bytes(whole[:50] if content == b"cut" else content)
    with caplog.at_level(logging.WARNING):
        mesh = load_mesh(gltf_quad(tmp_path, TEXTURED, PICTURE))
    assert mesh.parts[0].texture is None
    assert "quad.gltf" in caplog.text


def test_a_missing_material_file_is_a_warning(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "a.obj").write_text("mtllib gone.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl paint\nf 1 2 3\n")
    mesh = load_mesh(tmp_path / "a.obj")
    assert "gone.mtl" in caplog.text
    assert mesh.parts[0].name == "a"
    assert mesh.parts[0].base_color == (0.8, 0.8, 0.8)


def test_a_mesh_without_uvs_has_none_and_one_with_keeps_them_per_corner(tmp_path: Path) -> None:
    (tmp_path / "bare.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert load_mesh(tmp_path / "bare.obj").uv is None
    (tmp_path / "seam.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nvt 0.5 0.5\nf 1/1 2/2 3/3\nf 2/4 4/4 3/4\n"
    )
    seam = load_mesh(tmp_path / "seam.obj")
    assert len(seam.positions) == 4  # a UV seam does not cut the mesh
    assert seam.uv is not None
    np.testing.assert_allclose(np.sort(seam.uv.reshape(-1, 2), axis=0)[-1], [1, 1])
    assert [part.name for part in seam.parts] == ["seam"]


def test_faces_without_three_corners_go_and_double_faces_stay(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 0\nf 1 2 3\nf 1 2 3\nf 1 4 3\nf 2 2 3\n")
    with caplog.at_level(logging.INFO):
        mesh = load_mesh(tmp_path / "a.obj")
    assert mesh.faces.shape == (2, 3)
    assert "dropped 2 of 4" in caplog.text


def test_text_in_an_old_encoding_is_read(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_bytes(
        "# Größe\nmtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl tür\nf 1 2 3\n".encode("latin-1")
    )
    (tmp_path / "a.mtl").write_bytes("newmtl tür\nKd 0.5 0.5 0.5\n".encode("latin-1"))
    assert load_mesh(tmp_path / "a.obj").parts[0].name == "tür"


def test_polygons_become_triangles(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 2 0 0\nv 3 1 0\nv 1 2 0\nv -1 1 0\nf 1 2 3 4 5\nf 1 2 -1\n")
    assert area(load_mesh(tmp_path / "a.obj")) == pytest.approx(5.0 + 1.0)


def test_vertex_colors_are_averaged_in_linear_light(tmp_path: Path) -> None:
    box = trimesh.creation.box()
    box.visual.vertex_colors = np.array([[255, 255, 255, 255], [0, 0, 0, 255]] * 4, dtype=np.uint8)
    box.export(tmp_path / "a.ply")
    assert load_mesh(tmp_path / "a.ply").parts[0].base_color == pytest.approx((0.5, 0.5, 0.5))
