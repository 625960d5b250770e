"""A weathered GLB keeps exactly what docs/commands.md says of a mesh. If it keeps more, change that list."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import trimesh
from PIL import Image

import svbrdfgan as sg

FACE = np.array([[0.02, 0.02], [0.1, 0.02], [0.02, 0.1]])


def box(name: str, first: int) -> trimesh.Trimesh:
    """A half-transparent box of one material with every map; each face has a place of its own in UV."""
    corners = trimesh.creation.box((1, 0.6, 2)).triangles.reshape(-1, 3)
    place = first + np.arange(len(corners) // 3)
    uv = (np.stack([place % 6, place // 6], axis=1)[:, None] / 6 + FACE).reshape(-1, 2)
    picture = Image.new("RGBA", (8, 8), (200, 40, 40, 128))
    maps = dict.fromkeys(
        ("baseColorTexture", "normalTexture", "metallicRoughnessTexture", "occlusionTexture", "emissiveTexture"),
        picture,
    )
    material = trimesh.visual.material.PBRMaterial(name=name, alphaMode="BLEND", doubleSided=False, **maps)
    visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    return trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), visual=visual, process=False)


@pytest.fixture
def mesh(tmp_path: Path) -> sg.Mesh:
    scene = trimesh.Scene()
    scene.add_geometry(box("paint", 0), node_name="body")
    up = trimesh.transformations.translation_matrix([0, 0.6, 0])
    scene.add_geometry(box("glass", 12), node_name="roof", parent_node_name="body", transform=up)
    scene.export(tmp_path / "car.glb")
    return sg.load_mesh(tmp_path / "car.glb")


def weathered(mesh: sg.Mesh, embedding: str, path: Path) -> tuple[sg.Mesh, dict[str, Any]]:
    subject = sg.make_subject(mesh, sg.load_embedding(embedding), 32, sg.PartSelection())
    sg.write_embedded(path, subject, sg.Layer(torch.zeros(32, 32, 4)))
    data = path.read_bytes()
    return sg.load_mesh(path), json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])


def test_it_has_the_position_of_the_mesh_and_base_colour_alone(mesh: sg.Mesh, tmp_path: Path) -> None:
    result, header = weathered(mesh, "hemispherical", tmp_path / "out.glb")
    np.testing.assert_allclose(result.bounds, mesh.bounds, atol=1e-6)
    assert [node["name"] for node in header["nodes"]] == ["paint", "glass", "paint (hidden)", "glass (hidden)"]
    assert len(result.faces) > len(mesh.faces)
    for material in header["materials"]:
        assert material.keys() == {"name", "pbrMetallicRoughness", "alphaMode", "doubleSided", "extras"}
        assert material["extras"] == {"lambertian": True}
        assert (material["alphaMode"], material["doubleSided"]) == ("OPAQUE", True)
        maps = {key for key in material["pbrMetallicRoughness"] if key.endswith("Texture")}
        assert maps == {"baseColorTexture"}
    assert all("children" not in node for node in header["nodes"])


def test_given_keeps_uvs_and_faces(mesh: sg.Mesh, tmp_path: Path) -> None:
    result, header = weathered(mesh, "given", tmp_path / "out.glb")
    assert [node["name"] for node in header["nodes"]] == ["paint", "glass"]
    assert mesh.uv is not None
    assert result.uv is not None
    np.testing.assert_array_equal(result.positions[result.faces], mesh.positions[mesh.faces].astype(np.float32))
    np.testing.assert_allclose(result.uv, mesh.uv, atol=1e-6)
