"""What is written as GLB, byte by byte where it matters and read back where it can be."""

import json
import struct
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from svbrdfgan.errors import AssetError
from svbrdfgan.io.gltf.surface_files import save_glb, save_mesh_glb
from svbrdfgan.io.mesh import load_mesh
from svbrdfgan.types import Mesh, Part, Surface


def quad_surface(repeat: tuple[bool, bool] = (False, False)) -> Surface:
    """Two unit squares side by side in the XY plane, each a part; the UV square is stretched over both."""
    positions = np.array([[x, y, 0.0] for x in (0, 1, 2) for y in (0, 1)])
    faces = np.array([[0, 2, 3], [0, 3, 1], [2, 4, 5], [2, 5, 3]])
    return Surface(
        positions=positions,
        normals=np.tile([0.0, 0.0, 1.0], (6, 1)),
        uv=positions[:, :2] / [2, 1],
        faces=faces,
        face_part=np.array([0, 0, 1, 1]),
        parts=(
            Part("paint", (0.1234567, 0.2, 0.3)),
            Part("glass", (0.5, 0.5, 0.5), np.full((2, 2, 3), 0.5, np.float32)),
        ),
        elevation=np.zeros(6),
        source_face=np.arange(4),
        source_barycentric=np.tile(np.eye(3), (4, 1, 1)),
        repeat=repeat,
    )


def corners() -> torch.Tensor:
    """Row 0 is the bottom: blue, yellow; above it red, green."""
    return torch.tensor([[[0, 0, 1], [1, 1, 0]], [[1, 0, 0], [0, 1, 0]]], dtype=torch.float32)


def parse(path: Path) -> tuple[dict, bytes]:
    data = path.read_bytes()
    magic, version, length, size, kind = struct.unpack("<4sIII4s", data[:20])
    assert (magic, version, length, kind) == (b"glTF", 2, len(data), b"JSON")
    assert size % 4 == 0
    binary_size, binary_kind = struct.unpack("<I4s", data[20 + size : 28 + size])
    assert binary_kind == b"BIN\0"
    assert 28 + size + binary_size == len(data)
    return json.loads(data[20 : 20 + size]), data[28 + size :]


def accessor(header: dict, binary: bytes, index: int) -> np.ndarray:
    entry = header["accessors"][index]
    view = header["bufferViews"][entry["bufferView"]]
    data = binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
    columns = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}[entry["type"]]
    array = np.frombuffer(data, {5126: "<f4", 5125: "<u4"}[entry["componentType"]]).reshape(-1, columns)
    assert len(array) == entry["count"]
    assert view["byteOffset"] % 4 == 0
    return array


def picture(header: dict, binary: bytes, index: int) -> np.ndarray:
    view = header["bufferViews"][header["images"][index]["bufferView"]]
    return np.asarray(Image.open(BytesIO(binary[view["byteOffset"] :][: view["byteLength"]])))


def test_the_document_says_what_viewers_need(tmp_path: Path) -> None:
    save_glb(tmp_path / "a.glb", quad_surface(), {0: corners()})
    header, binary = parse(tmp_path / "a.glb")
    assert [mesh["name"] for mesh in header["meshes"]] == ["paint", "glass"]
    assert [node["name"] for node in header["nodes"]] == ["paint", "glass"]
    paint, glass = header["materials"]
    assert (paint["doubleSided"], paint["alphaMode"]) == (True, "OPAQUE")
    assert paint["pbrMetallicRoughness"]["metallicFactor"] == 0
    assert paint["pbrMetallicRoughness"]["roughnessFactor"] == 0.9
    assert paint["pbrMetallicRoughness"]["baseColorFactor"] == [1, 1, 1, 1]
    assert "baseColorTexture" not in glass["pbrMetallicRoughness"]
    assert glass["pbrMetallicRoughness"]["baseColorFactor"] == [0.25, 0.25, 0.25, 1]  # 0.5 times its texture's mean
    for mesh in header["meshes"]:
        primitive = mesh["primitives"][0]
        positions = accessor(header, binary, primitive["attributes"]["POSITION"])
        extent = header["accessors"][primitive["attributes"]["POSITION"]]
        assert (extent["min"], extent["max"]) == (positions.min(0).tolist(), positions.max(0).tolist())
        np.testing.assert_array_equal(accessor(header, binary, primitive["attributes"]["NORMAL"]), [[0, 0, 1]] * 4)
        indices = accessor(header, binary, primitive["indices"])
        a, b, c = positions[indices.reshape(-1, 3)].swapaxes(0, 1)
        np.testing.assert_array_equal(np.cross(b - a, c - a), [[0, 0, 1]] * 2)  # the winding is kept


def test_a_texture_is_upright_where_the_origin_is_the_upper_left(tmp_path: Path) -> None:
    save_glb(tmp_path / "a.glb", quad_surface(), {0: corners()})
    header, binary = parse(tmp_path / "a.glb")
    np.testing.assert_array_equal(picture(header, binary, 0)[0], [[255, 0, 0], [0, 255, 0]])  # the top row first
    attributes = header["meshes"][0]["primitives"][0]["attributes"]
    positions, uv = (accessor(header, binary, attributes[name]) for name in ("POSITION", "TEXCOORD_0"))
    np.testing.assert_allclose(uv, np.stack([positions[:, 0] / 2, 1 - positions[:, 1]], axis=1))


def test_a_texture_survives_as_srgb_of_eight_bits(tmp_path: Path) -> None:
    texture = torch.linspace(0, 1, 3 * 256).reshape(16, 16, 3)
    save_glb(tmp_path / "a.glb", quad_surface(), {0: texture})
    mesh = load_mesh(tmp_path / "a.glb")
    assert mesh.parts[0].texture is not None
    np.testing.assert_allclose(mesh.parts[0].texture, texture.numpy(), atol=0.0045)  # 2.28 / 255 / 2, the curve at 1
    assert mesh.uv is not None


def test_constant_colors_are_linear_and_exact(tmp_path: Path) -> None:
    save_glb(tmp_path / "a.glb", quad_surface(), {})
    assert load_mesh(tmp_path / "a.glb").parts[0].base_color == (0.1234567, 0.2, 0.3)


def test_one_texture_of_two_parts_is_stored_once(tmp_path: Path) -> None:
    texture = corners()
    save_glb(tmp_path / "a.glb", quad_surface(), {0: texture, 1: texture})
    header, _ = parse(tmp_path / "a.glb")
    assert len(header["images"]) == 1
    assert [m["pbrMetallicRoughness"]["baseColorTexture"]["index"] for m in header["materials"]] == [0, 0]


def test_alpha_is_blended_and_not_srgb(tmp_path: Path) -> None:
    save_glb(tmp_path / "a.glb", quad_surface(), {1: torch.full((2, 2, 4), 0.5)})
    header, binary = parse(tmp_path / "a.glb")
    assert [material["alphaMode"] for material in header["materials"]] == ["OPAQUE", "BLEND"]
    np.testing.assert_array_equal(picture(header, binary, 0)[0, 0], [188, 188, 188, 128])


def test_textures_clamp_or_repeat_as_the_surface_says(tmp_path: Path) -> None:
    save_glb(tmp_path / "a.glb", quad_surface((True, False)), {0: corners()})
    sampler = parse(tmp_path / "a.glb")[0]["samplers"][0]
    assert (sampler["wrapS"], sampler["wrapT"]) == (10497, 33071)


def test_a_part_without_faces_is_left_out(tmp_path: Path) -> None:
    surface = quad_surface()
    save_glb(tmp_path / "a.glb", Surface(**{**vars(surface), "face_part": np.zeros(4, np.int64)}), {})
    assert [mesh["name"] for mesh in parse(tmp_path / "a.glb")[0]["meshes"]] == ["paint"]


@pytest.mark.parametrize("textured", [False, True])
def test_a_mesh_comes_back_as_it_was(tmp_path: Path, textured: bool) -> None:
    surface = quad_surface()
    texture = (torch.arange(12).reshape(2, 2, 3) / 11).numpy() if textured else None
    parts = (Part("paint", (0.1, 0.2, 0.3), texture), Part("glass", (0.7, 0.8, 0.9)))
    uv = surface.uv[surface.faces] * 3 - 1 if textured else None  # a UV beyond the unit square, and seams
    if uv is not None:
        uv[1] += 0.25
    mesh = Mesh(surface.positions, surface.faces, surface.face_part, parts, uv)
    save_mesh_glb(tmp_path / "a.glb", mesh)
    again = load_mesh(tmp_path / "a.glb")
    np.testing.assert_array_equal(again.positions[again.faces], mesh.positions[mesh.faces])
    np.testing.assert_array_equal(again.face_part, mesh.face_part)
    assert [(part.name, part.base_color) for part in again.parts] == [(part.name, part.base_color) for part in parts]
    if uv is not None and texture is not None:
        assert again.uv is not None
        assert again.parts[0].texture is not None
        np.testing.assert_allclose(again.uv, uv, atol=1e-6)
        np.testing.assert_allclose(again.parts[0].texture, texture, atol=0.0045)
    else:
        assert again.uv is None


@pytest.mark.parametrize(
    ("name", "textures", "message"),
    [
        ("a.obj", {}, "does not end in .glb"),
        ("a.glb", {2: torch.zeros(2, 2, 3)}, "part 2"),
        ("a.glb", {0: torch.zeros(2, 2)}, "shape"),
        ("a.glb", {0: torch.zeros(2, 2, 1)}, "shape"),
    ],
)
def test_what_cannot_be_written_is_refused(tmp_path: Path, name: str, textures: dict, message: str) -> None:
    with pytest.raises(AssetError, match=message):
        save_glb(tmp_path / name, quad_surface(), textures)
    assert list(tmp_path.iterdir()) == []


def test_vertices_are_split_where_tangents_differ_and_written_where_normals_are(tmp_path: Path) -> None:
    """The first square's two faces have tangents of other hands; the second square has no normal map."""
    tangents = np.zeros((4, 3, 4))
    tangents[..., 0] = 1.0
    tangents[..., 3] = np.array([1.0, -1.0, 1.0, 1.0])[:, None]
    maps = {
        0: {"roughness": torch.tensor([0.5]), "normal": torch.zeros(2, 2, 3)},
        1: {"normal": torch.tensor([0, 0, 1.0])},
    }
    save_glb(tmp_path / "a.glb", quad_surface(), {}, maps, tangents)
    header, binary = parse(tmp_path / "a.glb")
    first, second = (mesh["primitives"][0]["attributes"] for mesh in header["meshes"])
    assert "TANGENT" not in second
    assert header["accessors"][first["TANGENT"]]["type"] == "VEC4"
    assert header["accessors"][first["POSITION"]]["count"] == 6  # four corners, two of them on both faces
    indices = accessor(header, binary, header["meshes"][0]["primitives"][0]["indices"]).ravel()
    np.testing.assert_array_equal(accessor(header, binary, first["TANGENT"])[indices], tangents[:2].reshape(6, 4))
    positions = accessor(header, binary, first["POSITION"])[indices]
    np.testing.assert_array_equal(positions, quad_surface().positions[quad_surface().faces[:2]].reshape(6, 3))


def test_a_part_keeps_its_alpha(tmp_path: Path) -> None:
    """A constant, and a texture over the surface's UV beside the base colour's."""
    surface, mask = quad_surface(), np.array([[0.0, 1.0], [1.0, 0.2]], np.float32)
    paint, glass = surface.parts
    parts = (Part("paint", paint.base_color, alpha=mask), Part("glass", glass.base_color, alpha=0.25))
    save_glb(tmp_path / "a.glb", Surface(**{**vars(surface), "parts": parts}), {0: corners()})
    header, binary = parse(tmp_path / "a.glb")
    assert [material["alphaMode"] for material in header["materials"]] == ["BLEND", "BLEND"]
    assert header["materials"][1]["pbrMetallicRoughness"]["baseColorFactor"] == [0.5, 0.5, 0.5, 0.25]
    np.testing.assert_array_equal(picture(header, binary, 0)[::-1, :, 3], (255 * mask).round())
    read = load_mesh(tmp_path / "a.glb").parts[0].file_maps["alpha"].texture
    assert read is not None
    np.testing.assert_allclose(read[..., 0], mask, atol=1e-6)
