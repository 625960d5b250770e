"""Weathered meshes as GLB and PNG: what was written is read back as the same maps, in the same frames."""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from svbrdfgan_hemispherical import HemisphericalEmbedding

from svbrdfgan.config.choices import PartSelection
from svbrdfgan.geometry.bake_materials import bake_file_maps
from svbrdfgan.geometry.rasterize import Fragments
from svbrdfgan.geometry.tangents import corner_tangents
from svbrdfgan.io.image import load_image, srgb_from_linear
from svbrdfgan.io.mesh import load_mesh
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.vehicle import build_vehicle
from svbrdfgan.scene.embedded_files import write_embedded
from svbrdfgan.scene.subject import Subject, make_subject
from svbrdfgan.types import FileMap, Layer, Materials, Mesh, Part

MAPS = {"roughness": 0.25, "metallic": 0.5, "normal": 0.0}
TEXELS = 32


def given(part: Part) -> Part:
    """The part as if from a file: glass has alpha, rims shine."""
    maps = {"roughness": FileMap((0.375,)), "metallic": FileMap((1.0 if part.name == "rim" else 0.0,))}
    if part.name == "glass":
        maps["alpha"] = FileMap((0.25,))
    return Part(part.name, part.base_color, file_maps={} if part.name == "tyre" else maps)


@pytest.fixture(scope="module")
def subject() -> Subject:
    mesh = build_vehicle(sample_vehicle("van", 5))
    mesh = Mesh(mesh.positions, mesh.faces, mesh.face_part, tuple(map(given, mesh.parts)))
    return make_subject(mesh, HemisphericalEmbedding(resolution=TEXELS), TEXELS, PartSelection(), file_maps=True)


@pytest.fixture(scope="module")
def layer() -> Layer:
    """Smooth, with normals that tilt to all sides and are not of length one."""
    v, u = torch.meshgrid(*[(torch.arange(TEXELS) + 0.5) / TEXELS] * 2, indexing="ij")
    tilt = [0.6 * torch.sin(6.3 * u), 0.6 * torch.cos(6.3 * v), torch.full_like(u, 0.7)]
    values = torch.stack([u, v, 1 - u, 0.5 + 0.5 * u, 1 - v, 0.5 * v, *tilt], dim=-1)
    return Layer(values, ("roughness", "metallic", "normal"))


@pytest.fixture(scope="module")
def written(subject: Subject, layer: Layer, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path: Path = tmp_path_factory.mktemp("weathered") / "car.glb"
    write_embedded(path, subject, layer, MAPS)
    return path


@pytest.fixture(scope="module")
def materials(subject: Subject, layer: Layer) -> Materials:
    return subject.materials(layer, MAPS)


def header_of(path: Path) -> tuple[dict[str, Any], bytes]:
    data = path.read_bytes()
    size = struct.unpack("<I", data[12:16])[0]
    return json.loads(data[20 : 20 + size]), data[28 + size :]


def accessor(header: dict[str, Any], binary: bytes, index: int) -> np.ndarray:
    entry = header["accessors"][index]
    view = header["bufferViews"][entry["bufferView"]]
    columns = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}[entry["type"]]
    data = binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
    return np.frombuffer(data, {5126: "<f4", 5125: "<u4"}[entry["componentType"]]).reshape(-1, columns)


def unit(normal: torch.Tensor) -> torch.Tensor:
    return torch.nn.functional.normalize(normal, dim=-1)


def test_every_map_is_a_picture_beside_it(written: Path, subject: Subject, materials: Materials) -> None:
    names = {f"car.{name}" for name in ("glb", "layer.png", "roughness.png", "metallic.png", "normal.png")}
    assert {path.name for path in written.parent.iterdir()} == names
    painted = materials[subject.learnable[0]].maps
    for name in MAPS:
        stored = srgb_from_linear(load_image(written.with_suffix(f".{name}.png")).flip(0))
        expected = 0.5 + 0.5 * unit(painted[name]) if name == "normal" else painted[name]
        torch.testing.assert_close(stored[..., : expected.shape[-1]], expected, atol=0.6 / 255, rtol=0)


def test_the_file_says_what_was_rendered(written: Path, subject: Subject, materials: Materials) -> None:
    read = {part.name: part for part in load_mesh(written).parts}
    for number, part in enumerate(subject.surface.parts):
        found, maps = read[part.name].file_maps, materials[number].maps
        assert (part.name.startswith("glass")) == ("alpha" in found)
        assert ("roughness" in found) == ("roughness" in maps) == (not part.name.startswith("tyre"))
        for name in found.keys() & maps.keys():
            texture = found[name].texture
            value = torch.tensor(found[name].factor)
            if maps[name].ndim == 1:
                assert texture is None
                torch.testing.assert_close(value, maps[name])
            else:
                assert texture is not None
                expected = unit(maps[name]) if name == "normal" else maps[name]
                step = (2.0 if name == "normal" else 1.0) / 255
                torch.testing.assert_close(value * torch.from_numpy(texture), expected, atol=0.6 * step, rtol=0)
    assert read["glass"].file_maps["alpha"].factor == (0.25,)


def test_normals_come_back_in_the_frame_that_they_were_painted_in(written: Path, subject: Subject) -> None:
    """The mesh that was read, over its own UVs, as an embedding that keeps them gives it."""
    mesh = load_mesh(written)
    assert mesh.uv is not None
    surface = subject.surface
    order = np.concatenate([np.flatnonzero(surface.face_part == part) for part in range(len(surface.parts))])
    again = replace(
        surface,
        faces=surface.faces[order],
        face_part=surface.face_part[order],
        source_face=np.arange(len(order)),
        source_barycentric=np.tile(np.eye(3), (len(order), 1, 1)),
        parts=mesh.parts,
    )
    np.testing.assert_allclose(mesh.uv, again.uv[again.faces], atol=1e-6)
    fragments = Fragments.of(again, TEXELS, TEXELS)
    part = subject.learnable[0]
    shown = fragments.outermost(again.face_part == part).mask
    baked = bake_file_maps(mesh, fragments)[part]["normal"].numpy()[shown]
    texture = mesh.parts[part].file_maps["normal"].texture
    assert texture is not None
    cosine = (baked * unit(torch.from_numpy(texture.copy())).numpy()[shown]).sum(-1)
    assert cosine.min() > 0.9999


def test_tangents_are_those_of_the_surface(written: Path, subject: Subject) -> None:
    header, binary = header_of(written)
    meshes = {mesh["name"]: mesh["primitives"][0] for mesh in header["meshes"]}
    tangents = corner_tangents(subject.surface).attribute()
    for number, part in enumerate(subject.surface.parts):
        primitive = meshes[part.name]
        normal_mapped = "normalTexture" in header["materials"][primitive["material"]]
        assert normal_mapped == (number in subject.learnable) == ("TANGENT" in primitive["attributes"])
        if not normal_mapped:
            continue
        indices = accessor(header, binary, primitive["indices"]).ravel()
        found, normal, uv = (
            accessor(header, binary, primitive["attributes"][name])[indices]
            for name in ("TANGENT", "NORMAL", "TEXCOORD_0")
        )
        chosen = subject.surface.face_part == number
        np.testing.assert_allclose(found, tangents[chosen].reshape(-1, 4), atol=1e-6)
        np.testing.assert_allclose(np.linalg.norm(found[:, :3], axis=1), 1.0, atol=1e-6)
        np.testing.assert_allclose((found[:, :3] * normal).sum(axis=1), 0.0, atol=1e-6)
        assert set(found[:, 3]) <= {-1.0, 1.0}
        np.testing.assert_allclose(
            uv[:, 1], 1 - subject.surface.uv[subject.surface.faces[chosen]].reshape(-1, 2)[:, 1], atol=1e-6
        )


def test_base_colour_alone_is_written_as_before(subject: Subject, layer: Layer, tmp_path: Path) -> None:
    write_embedded(tmp_path / "car.glb", subject, Layer(layer.rgba))
    header, _ = header_of(tmp_path / "car.glb")
    assert {path.name for path in tmp_path.iterdir()} == {"car.glb", "car.layer.png"}
    assert all("normalTexture" not in material for material in header["materials"])
    assert all("TANGENT" not in mesh["primitives"][0]["attributes"] for mesh in header["meshes"])
