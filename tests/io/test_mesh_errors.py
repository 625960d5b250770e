"""Every bad mesh file gives one sentence that names it."""

import json
import struct
import time
from collections.abc import Callable
from functools import partial
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from svbrdfgan.errors import AssetError
from svbrdfgan.io.mesh import load_mesh

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"


def exported(suffix: str) -> bytes:
    data = trimesh.creation.icosphere(subdivisions=1).export(file_type=suffix)
    return data.encode() if isinstance(data, str) else data


def glb(header: dict, binary: bytes = b"") -> bytes:
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def gltf(**changes: object) -> dict:
    header: dict = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "buffers": [{"byteLength": 36}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
    }
    return header | changes


def cut(suffix: str) -> bytes:
    return exported(suffix)[:900]


CORNERS = np.eye(3, dtype="<f4").tobytes()
HUGE = {"componentType": 5126, "count": 10**12, "type": "VEC3"}
BIG_STL = b"\0" * 80 + struct.pack("<I", 4_000_000_000) + b"\0" * 50
BIG_PLY = (
    b"ply\nformat binary_little_endian 1.0\nelement vertex 900000000000\n"
    b"property float x\nproperty float y\nproperty float z\n"
    b"element face 900000000000\nproperty list uchar int vertex_indices\nend_header\n" + b"\0" * 64
)

UV = {"bufferView": 1, "componentType": 5126, "count": 2, "type": "VEC2"}


def textured(**material: object) -> dict:
    """The header of a triangle with UVs and a material."""
    primitive = {"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": 0}
    return gltf(
        meshes=[{"primitives": [primitive]}],
        materials=[material],
        buffers=[{"byteLength": 60}],
        bufferViews=[{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 24}],
        accessors=[*gltf()["accessors"], UV | {"count": 3}],
    )


def two_uvs() -> dict:
    """The header of a triangle with UVs for two of its vertices."""
    header = textured()
    return header | {"accessors": [*gltf()["accessors"], UV]}


def sets(name: str) -> dict:
    """A mesh with an attribute of this name."""
    return {"primitives": [{"attributes": {"POSITION": 0, name: 0}}]}


NOT_FINITE: dict[str, dict] = {
    "alpha cutoff": {"alphaMode": "MASK", "alphaCutoff": float("nan")},
    "normal scale": {"normalTexture": {"index": 0, "scale": float("inf")}},
    "occlusion strength": {"occlusionTexture": {"index": 0, "strength": float("nan")}},
    "factor": {"pbrMetallicRoughness": {"baseColorFactor": [1, float("nan"), 1, 1]}},
}
WRONG_MATERIALS: dict[str, dict] = {
    "texture that is a number": {"occlusionTexture": 3},
    "texture without index": {"emissiveTexture": {}},
    "factor of three": {"pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1]}},
    "roughness of three": {"pbrMetallicRoughness": {"roughnessFactor": [1, 1, 1]}},
    "factor of words": {"emissiveFactor": ["a", "b", "c"]},
    "extension that is a list": {"extensions": {"KHR_materials_clearcoat": [1]}},
    "scale of normals in text": {"normalTexture": {"index": 0, "scale": "nan"}},
    "scale of a texture in text": {
        "normalTexture": {"index": 0, "extensions": {"KHR_texture_transform": {"scale": ["nan", 1]}}}
    },
    "offset of three": {"normalTexture": {"index": 0, "extensions": {"KHR_texture_transform": {"offset": [1, 1, 1]}}}},
    "cutoff beyond floats": {"alphaMode": "MASK", "alphaCutoff": 10**400},
}
NESTED = {"nodes": [{"children": [k + 1]} for k in range(40_000)] + [{"mesh": 0}]}
THREE = {"scenes": [{"nodes": [0, 1, 2]}]}
PATHS = {"nodes": [{"children": [k + 2 - k % 2, k + 3 - k % 2]} for k in range(40)] + [{"mesh": 0}] * 2}
"""From each node two ways lead on, to the same two."""
REPEATED = {"scenes": [{"nodes": [0] * 2000}], "nodes": [{"children": [1] * 2000}, {"mesh": 0}]}

BAD: dict[str, tuple[str, Callable[[], bytes], str]] = {
    **{f"empty {s}": (f"a.{s}", lambda: b"", "is empty") for s in ("glb", "gltf", "obj", "ply", "stl")},
    **{f"garbage {s}": (f"a.{s}", lambda: b"\x07\xff garbage" * 99, "") for s in ("glb", "gltf", "obj", "ply", "stl")},
    **{f"cut {s}": (f"a.{s}", partial(cut, s), "") for s in ("glb", "ply", "stl")},
    "glb cut in its head": ("a.glb", lambda: b"glTF\2\0\0", "cut short"),
    "wrong suffix": ("a.fbx", lambda: b"x", "is not a mesh file"),
    "no suffix": ("a", lambda: b"x", "is not a mesh file"),
    "obj named glb": ("a.glb", lambda: TRIANGLE.encode(), "is not a GLB file"),
    "glb named obj": ("a.obj", lambda: exported("glb"), "is not an OBJ file"),
    "glb of version 1": ("a.glb", lambda: b"glTF" + struct.pack("<4I", 1, 20, 0, 0), "version 1"),
    "gltf without asset": ("a.gltf", lambda: b"[1, 2]", "no 'asset'"),
    "gltf of wrong types": ("a.gltf", lambda: b'{"asset": {"version": "2.0"}, "meshes": 3}', "cannot be read"),
    "gltf without its buffer": (
        "a.gltf",
        lambda: json.dumps(gltf(buffers=[{"uri": "gone.bin", "byteLength": 36}])).encode(),
        "gone.bin' that it names is missing",
    ),
    "gltf of a trillion vertices": ("a.glb", lambda: glb(gltf(accessors=[HUGE]), CORNERS), "at most"),
    "gltf of many vertices without bytes": (
        "a.glb",
        lambda: glb(gltf(accessors=[HUGE | {"count": 90_000_000}]), CORNERS),
        "without storing them",
    ),
    "gltf of more triangles than are read": (
        "a.glb",
        lambda: glb(gltf(accessors=[HUGE | {"count": 60_000_000}], nodes=[{"mesh": 0}] * 3) | THREE, CORNERS),
        "wanted a mesh of 1 to",
    ),
    "gltf with UVs for some vertices": ("a.glb", lambda: glb(two_uvs(), CORNERS + CORNERS), "TEXCOORD_0 of 2"),
    **{
        f"gltf with {name}": ("a.glb", lambda name=name: glb(gltf(meshes=[sets(name)]), CORNERS), "wanted TEXCOORD_0")
        for name in ("TEXCOORD_500", "TEXCOORD_999999999", "TEXCOORD_x")
    },
    "gltf of nested nodes": ("a.glb", lambda: glb(gltf(**NESTED), CORNERS), "above one another"),
    "gltf of nodes named often": ("a.glb", lambda: glb(gltf(**PATHS), CORNERS), "shows more than"),
    **{
        f"gltf with {what} not finite": ("a.glb", lambda m=m: glb(textured(**m), CORNERS + CORNERS), "not finite")
        for what, m in NOT_FINITE.items()
    },
    **{
        f"gltf with a {what}": ("a.glb", lambda m=m: glb(textured(**m), CORNERS + CORNERS), "cannot be read as glTF")
        for what, m in WRONG_MATERIALS.items()
    },
    "gltf with an index out of range": (
        "a.glb",
        lambda: glb(
            gltf(
                meshes=[{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
                accessors=[
                    {"bufferView": 0, "componentType": 5126, "count": 2, "type": "VEC3"},
                    {"bufferView": 0, "componentType": 5125, "count": 9, "type": "SCALAR"},
                ],
            ),
            CORNERS,
        ),
        "outside 0..1",
    ),
    "gltf of points": (
        "a.glb",
        lambda: glb(gltf(meshes=[{"primitives": [{"attributes": {"POSITION": 0}, "mode": 0}]}]), CORNERS),
        "only points",
    ),
    "gltf of nothing": ("a.glb", lambda: glb({"asset": {"version": "2.0"}}), ""),
    "obj of points": ("a.obj", lambda: TRIANGLE.encode(), "only points"),
    "obj of comments": ("a.obj", lambda: b"# nothing\n", "no faces"),
    "obj with an index out of range": ("a.obj", lambda: (TRIANGLE + "f 1 2 9\n").encode(), ""),
    "obj with NaN": ("a.obj", lambda: b"v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "not finite"),
    "ply of points": ("a.ply", lambda: trimesh.PointCloud(np.eye(3)).export(file_type="ply"), "only points"),
    "stl of four billion": ("a.stl", lambda: BIG_STL, "cut short"),
    "ply of a trillion": ("a.ply", lambda: BIG_PLY, ""),
    "too far away": ("a.obj", lambda: (TRIANGLE + "v 1e12 0 0\nf 1 2 4\nf 1 2 3\n").encode(), "1e+12"),
    "all in one point": ("a.obj", lambda: b"v 0 0 0\nv 0 0 0\nv 0 0 0\nf 1 2 3\n", "without area"),
    "all on one line": ("a.obj", lambda: b"v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", "no area"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_file_gives_one_sentence_that_names_it(tmp_path: Path, case: str) -> None:
    name, content, wanted = BAD[case]
    path = tmp_path / name
    path.write_bytes(content())
    with pytest.raises(AssetError) as caught:
        load_mesh(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert wanted in message
    assert message.endswith((".", "?"))
    assert "\n" not in message


@pytest.mark.parametrize("suffix", ["glb", "ply", "stl"])
def test_vertices_that_are_not_finite_are_refused(tmp_path: Path, suffix: str) -> None:
    box = trimesh.creation.box()
    vertices = box.vertices.copy()
    vertices[3, 1] = np.nan
    trimesh.Trimesh(vertices, box.faces, process=False, validate=False).export(tmp_path / f"a.{suffix}")
    with pytest.raises(AssetError, match="not finite"):
        load_mesh(tmp_path / f"a.{suffix}")


def test_a_path_that_is_missing_or_a_folder(tmp_path: Path) -> None:
    with pytest.raises(AssetError, match="does not exist"):
        load_mesh(tmp_path / "gone.glb")
    (tmp_path / "folder.glb").mkdir()
    with pytest.raises(AssetError, match="is a folder"):
        load_mesh(tmp_path / "folder.glb")


@pytest.mark.parametrize("named", ["../secret.mtl", "{folder}/secret.mtl", "linked.mtl", "..\\secret.mtl"])
def test_what_a_mesh_names_outside_of_its_folder_is_not_read(
    named: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "secret.mtl").write_text("newmtl paint\nKd 1 0 0\n")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "linked.mtl").symlink_to(tmp_path / "secret.mtl")
    lines = f"mtllib {named.format(folder=tmp_path)}\n{TRIANGLE}usemtl paint\nf 1 2 3\n"
    (tmp_path / "mine" / "a.obj").write_text(lines)
    assert load_mesh(tmp_path / "mine" / "a.obj").parts[0].base_color == (0.8, 0.8, 0.8)
    assert "which is missing or outside of its folder" in caplog.text


def test_a_device_is_not_waited_for(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text(f"mtllib /dev/zero\nmtllib /proc/kmsg\n{TRIANGLE}usemtl paint\nf 1 2 3\n")
    assert len(load_mesh(tmp_path / "a.obj").faces) == 1


@pytest.mark.parametrize("name", [{"a": 1}, ["a"], 7, True, None])
def test_a_material_s_name_that_is_no_text_is_none(name: object, tmp_path: Path) -> None:
    primitive = {"attributes": {"POSITION": 0}, "material": 0}
    header = gltf(meshes=[{"primitives": [primitive]}], materials=[{"name": name}])
    (tmp_path / "a.glb").write_bytes(glb(header, CORNERS))
    assert [part.name for part in load_mesh(tmp_path / "a.glb").parts] == ["a"]


def test_texture_coordinates_of_one_number_are_none(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text(f"{TRIANGLE}vt 0\nvt 1\nvt 2\nf 1/1 2/2 3/3\n")
    assert load_mesh(tmp_path / "a.obj").uv is None


def test_a_picture_that_a_mesh_names_and_that_is_missing_is_told_in_one_sentence(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    header = "ply\nformat ascii 1.0\ncomment TextureFile gone.png\nelement vertex 3\nproperty float x\n"
    header += "property float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    (tmp_path / "a.ply").write_text(f"{header}0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")
    load_mesh(tmp_path / "a.ply")
    assert [record.getMessage() for record in caplog.records] == [
        f"{tmp_path / 'a.ply'} names the file 'gone.png', which is missing or outside of its folder"
    ]


def test_thousands_of_materials_of_one_name_are_named_apart_at_once(tmp_path: Path) -> None:
    count = 5_000
    primitive = {"attributes": {"POSITION": 0}}
    materials = [{"name": "m", "pbrMetallicRoughness": {"roughnessFactor": k / count}} for k in range(count)]
    header = gltf(meshes=[{"primitives": [primitive | {"material": k} for k in range(count)]}], materials=materials)
    path = tmp_path / "a.glb"
    path.write_bytes(glb(header, CORNERS))
    begun = time.process_time()
    names = [part.name for part in load_mesh(path).parts]
    assert time.process_time() - begun < 10.0
    assert names == ["m", *(f"m_{k}" for k in range(2, count + 1))]


def test_a_texture_of_too_many_texels_is_left_out(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    stream = BytesIO()
    Image.new("1", (13_000, 13_000)).save(stream, "PNG")
    header = textured(pbrMetallicRoughness={"baseColorTexture": {"index": 0}})
    header |= {
        "bufferViews": [*header["bufferViews"], {"buffer": 0, "byteOffset": 72, "byteLength": len(stream.getvalue())}],
        "buffers": [{"byteLength": 72 + len(stream.getvalue())}],
        "images": [{"bufferView": 2, "mimeType": "image/png"}],
        "textures": [{"source": 0}],
    }
    path = tmp_path / "a.glb"
    path.write_bytes(glb(header, CORNERS + CORNERS + stream.getvalue()))
    assert load_mesh(path).parts[0].texture is None
    assert "13000 x 13000 texels; wanted at most 100 million" in caplog.text


def test_a_node_that_a_list_names_twice_stands_there_once(tmp_path: Path) -> None:
    (tmp_path / "a.glb").write_bytes(glb(gltf(**REPEATED), CORNERS))
    assert len(load_mesh(tmp_path / "a.glb").faces) == 1
