"""Weathering may change what it is allowed to, and nothing beside."""

from copy import deepcopy
from pathlib import Path

import numpy as np
import pytest
from documents import differences
from full_files import full_files
from gltf_reader import Decoders, read
from permissions import Allowed, Change, weathering
from sample_document import PNG, Pieces, sample_document, write
from test_documents import MUTATIONS, Mutate, changed

COVERED = {
    *("a factor", "another texture", "another texture in an extension", "a texture's UV set", "a normal map's scale"),
    *("a texture's transform", "a wrap mode", "no sampler", "a texture's name", "a texture's byte"),
    *("a WebP texture's byte", "an image's name", "a material more", "the generator", "a UV set more"),
}
"""The mutations that concern nothing but the textures and factors of Paint, UV sets, copies and the stamp."""


def weathered(pieces: Pieces) -> None:
    """Paint with another texture over a further UV set, which splits a vertex, in copies of material and mesh."""
    primitive = deepcopy(pieces["meshes"][0]["primitives"][0])
    arrays = pieces["accessors"]
    for name, accessor in primitive["attributes"].items():
        array = arrays[accessor]["array"]
        primitive["attributes"][name] = len(arrays)
        arrays.append({**arrays[accessor], "array": np.concatenate([array, array[2:3]])})
    primitive["attributes"]["TEXCOORD_2"] = len(arrays)
    primitive["indices"] = len(arrays) + 1
    arrays += [{"array": np.zeros((5, 2), "f4")}, {"array": np.array([[0], [1], [2], [4], [1], [3]], "u4")}]
    primitive["material"] = len(pieces["materials"])
    pieces["images"].append({"bytes": PNG + b"rust"})
    pieces["textures"].append({"source": len(pieces["images"]) - 1})
    base = {"index": len(pieces["textures"]) - 1, "texCoord": 2}
    maps = {"baseColorTexture": base, "metallicRoughnessTexture": base}
    pieces["materials"].append({**pieces["materials"][0], "name": "Paint.001", "pbrMetallicRoughness": maps})
    primitive["extensions"]["KHR_materials_variants"]["mappings"][0]["material"] = len(pieces["materials"]) - 1
    pieces["meshes"].append({**pieces["meshes"][0], "name": "Body.001"})
    pieces["meshes"][-1]["primitives"] = [primitive, *pieces["meshes"][0]["primitives"][1:]]
    pieces["nodes"][0]["mesh"] = len(pieces["meshes"]) - 1
    pieces["asset"] |= {"generator": "svbrdfgan", "extras": {"author": "B", "seed": 7}}


def test_weathering_is_no_difference_where_it_is_allowed(tmp_path: Path) -> None:
    assert changed(weathered, tmp_path, weathering("Paint")) == []
    assert changed(weathered, tmp_path, weathering(0)) == []


@pytest.mark.parametrize("kind", [Change.TEXTURES, Change.FACTORS, Change.UV_SETS, Change.COPIES, Change.STAMP])
def test_each_kind_of_change_needs_its_permission(kind: Change, tmp_path: Path) -> None:
    assert changed(weathered, tmp_path, Allowed(frozenset({"Paint"}), ~kind))


def test_weathering_another_material_is_a_difference(tmp_path: Path) -> None:
    assert changed(weathered, tmp_path, weathering("Glass", "Blue"))


@pytest.mark.parametrize("name", MUTATIONS)
def test_what_weathering_may_not_touch_is_found_beside_it(name: str, tmp_path: Path) -> None:
    def mutate(pieces: Pieces) -> None:
        MUTATIONS[name][0](pieces)

    assert bool(changed(mutate, tmp_path, weathering("Paint"))) == (name not in COVERED)


def _split_wrongly(pieces: Pieces) -> None:
    weathered(pieces)
    pieces["accessors"][-1]["array"][3] = 3


def _moved(pieces: Pieces) -> None:
    weathered(pieces)
    pieces["accessors"][pieces["meshes"][-1]["primitives"][0]["attributes"]["TEXCOORD_0"]]["array"][4] += 1


def _other_side(pieces: Pieces) -> None:
    weathered(pieces)
    pieces["materials"][-1]["doubleSided"] = False


@pytest.mark.parametrize("mutate", [_split_wrongly, _moved, _other_side])
def test_a_wrong_weathering_is_found(mutate: Mutate, tmp_path: Path) -> None:
    assert changed(mutate, tmp_path, weathering("Paint"))


def test_a_strip_may_become_triangles_of_the_same_corners(tmp_path: Path) -> None:
    def taken_apart(pieces: Pieces) -> None:
        primitive = pieces["meshes"][0]["primitives"][1]
        primitive["mode"] = 4
        primitive["indices"] = 4
        pieces["accessors"][4]["array"][3:, 0] = [1, 3, 2]

    def shared_indices_kept(pieces: Pieces) -> None:
        array = pieces["accessors"][4]["array"].copy()
        taken_apart(pieces)
        pieces["accessors"] += [{"array": pieces["accessors"][4]["array"].copy()}]
        pieces["accessors"][4]["array"] = array
        pieces["meshes"][0]["primitives"][1]["indices"] = len(pieces["accessors"]) - 1

    assert changed(shared_indices_kept, tmp_path, weathering("Glass")) == []
    assert changed(taken_apart, tmp_path, weathering("Glass")) != []
    assert changed(shared_indices_kept, tmp_path, weathering("Paint")) != []


def test_primitives_without_material_may_get_one(tmp_path: Path) -> None:
    def mutate(pieces: Pieces) -> None:
        pieces["meshes"][1]["primitives"][0]["material"] = 2

    assert changed(mutate, tmp_path, weathering(None)) == []
    assert changed(mutate, tmp_path, weathering("Paint")) != []


def test_geometry_may_be_decompressed_with_a_decoder(tmp_path: Path) -> None:
    """The decoder of this test knows the arrays that the compressed bytes stand for."""
    plain = sample_document()
    arrays = [accessor["array"] for accessor in plain["accessors"]]
    packed = sample_document()
    primitive = packed["meshes"][1]["primitives"][0]
    primitive["extensions"] = {"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {"POSITION": 3}}}
    for pieces in (plain, packed):
        pieces["extensionsUsed"] = ["KHR_draco_mesh_compression"] if pieces is packed else []
        pieces["accessors"].append({"array": arrays[0] if pieces is plain else np.zeros_like(arrays[0])})
        pieces["meshes"][1]["primitives"][0]["attributes"]["POSITION"] = len(pieces["accessors"]) - 1
    decoders = Decoders(draco=lambda data, ids: (arrays[4][:, 0], dict.fromkeys(ids, arrays[0])))
    before, after = write(packed, tmp_path / "packed.glb"), write(plain, tmp_path / "plain.glb")
    unpacking = Allowed(what=Change.DECOMPRESSION)
    assert differences(read(before, decoders), read(after), unpacking) == []
    assert differences(read(before, decoders), read(after)) != []
    assert differences(read(before), read(after), unpacking) != []


@pytest.mark.assets
def test_real_files_do_not_differ_from_themselves(assets: Path) -> None:
    for file in full_files(assets):
        assert differences(read(file.path), read(file.path), weathering(0)) == [], file.name


@pytest.mark.assets
def test_decoded_positions_of_real_files_lie_in_the_bounds_that_the_files_state(assets: Path) -> None:
    checked = 0
    for file in full_files(assets):
        document = read(file.path)
        for index, accessor in enumerate(document.items("accessors")):
            if "min" in accessor and "bufferView" in accessor and not document.is_packed(accessor["bufferView"]):
                values = document.accessor(index)
                assert np.allclose([values.min(0), values.max(0)], [accessor["min"], accessor["max"]], 1e-5, 1e-6)
                checked += 1
    assert checked > 300
