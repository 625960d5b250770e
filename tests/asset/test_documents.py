"""The comparison of documents finds each small change, and no change in what was merely packed another way."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from documents import differences
from gltf_reader import read
from permissions import NOTHING, Allowed
from renumbering import renumbered
from sample_document import Pieces, interleaved, sample_document, separate, sparse, write

Mutate = Callable[[Pieces], Any]


def set_at(*keys: Any) -> Mutate:
    """Puts the last of the keys at the place that the others name."""
    *way, last, value = keys

    def mutate(pieces: Pieces) -> None:
        below: Any = pieces
        for key in way:
            below = below[key]
        below[last] = value

    return mutate


def drop(*keys: Any) -> Mutate:
    """Removes what the keys name."""
    *way, last = keys

    def mutate(pieces: Pieces) -> None:
        below: Any = pieces
        for key in way:
            below = below[key]
        del below[last]

    return mutate


def nudge(accessor: int) -> Mutate:
    """Changes the last number of an array by its last bit."""

    def mutate(pieces: Pieces) -> None:
        array = pieces["accessors"][accessor]["array"]
        array[-1, -1] = array[-1, -1] + 1 if array.dtype.kind == "u" else np.nextafter(array[-1, -1], np.float32(9))

    return mutate


PAINT = ("materials", 0)
SHELL = ("meshes", 0, "primitives", 0)
MAPPINGS = (*SHELL, "extensions", "KHR_materials_variants", "mappings")
CLEARCOAT = (*PAINT, "extensions", "KHR_materials_clearcoat")
CHANNELS = ("animations", 0, "channels")

MUTATIONS: dict[str, tuple[Mutate, str]] = {
    "a node's name": (set_at("nodes", 0, "name", "Auto"), "node 0 'Car' > name: was 'Car', is 'Auto'"),
    "a transform": (set_at("nodes", 1, "translation", 0, 1.001), "node 1 'Wheel.L' > translation[0]"),
    "a rotation gone": (drop("nodes", 2, "rotation"), "rotation: is gone"),
    "a matrix more": (set_at("nodes", 3, "scale", [1, 1, 1]), "scale: is new"),
    "extras of a node": (drop("nodes", 0, "extras"), "extras: is gone"),
    "extras of a mesh": (set_at("meshes", 0, "extras", "part", "lid"), "extras > part"),
    "extras of a primitive": (drop("meshes", 0, "primitives", 1, "extras", "lod"), "lod: is gone"),
    "extras of a material": (drop(*PAINT, "extras"), "material 0 'Paint' > extras: is gone"),
    "extras of the scene": (set_at("scenes", 0, "extras", "floor", 1), "scene 0 'Scene' > extras > floor"),
    "extras of the root": (drop("extras"), "extras: is gone"),
    "a node less": (drop("nodes", 0, "children", 2), "children: were 3"),
    "a node elsewhere": (set_at("nodes", 0, "children", [2, 1, 3]), "name: was 'Wheel.L', is 'Wheel.R'"),
    "the loose node in the scene": (set_at("scenes", 0, "nodes", [0, 4, 6, 7]), "loose: were 1"),
    "the default scene": (drop("scene"), "scene: is gone"),
    "another mesh": (set_at("nodes", 2, "mesh", 2), "mesh > mesh 1 'Wheel'"),
    "a mesh's name": (set_at("meshes", 1, "name", "Tyre"), "mesh 1 'Wheel' > name"),
    "a position": (nudge(0), "POSITION > accessor 0 'corners' > values: differs in 1 of 4 rows"),
    "a normal": (nudge(1), "NORMAL"),
    "an index": (nudge(4), "indices > accessor 4 > values"),
    "joints": (nudge(5), "JOINTS_0"),
    "weights": (nudge(6), "WEIGHTS_0"),
    "weights no longer normalised": (drop("accessors", 6, "normalized"), "WEIGHTS_0"),
    "an accessor's name": (drop("accessors", 0, "name"), "name: is gone"),
    "inverse bind matrices": (nudge(7), "inverseBindMatrices"),
    "a morph target": (nudge(8), "targets[0] > POSITION"),
    "a morph target less": (drop("meshes", 2, "primitives", 0, "targets"), "targets: is gone"),
    "default weights": (set_at("meshes", 2, "weights", [0.6]), "weights[0]"),
    "weights of a node": (set_at("nodes", 6, "weights", [0.6]), "weights[0]"),
    "a UV set lost": (drop(*SHELL, "attributes", "TEXCOORD_1"), "TEXCOORD_1: is gone"),
    "a UV set more": (set_at(*SHELL, "attributes", "TEXCOORD_2", 2), "TEXCOORD_2: is new"),
    "a primitive's mode": (set_at("meshes", 0, "primitives", 1, "mode", 6), "mode: was 5, is 6"),
    "a primitive less": (drop("meshes", 0, "primitives", 1), "primitives: were 2"),
    "a joint": (set_at("skins", 0, "joints", [5, 4]), "skin 0 'Rig' > joints[0]"),
    "a skeleton": (drop("skins", 0, "skeleton"), "skeleton: is gone"),
    "no skin": (drop("nodes", 6, "skin"), "skin: is gone"),
    "a key's time": (nudge(9), "input"),
    "a key's value": (nudge(10), "output"),
    "interpolation": (drop("animations", 0, "samplers", 0, "interpolation"), "interpolation: is gone"),
    "an animation channel": (drop(*CHANNELS, 1), "channels: were 2"),
    "an animated node": (set_at(*CHANNELS, 0, "target", "node", 2), "target > node"),
    "an animated path": (set_at(*CHANNELS, 0, "target", "path", "scale"), "target > path"),
    "an animation": (drop("animations", 0), "animations: were 1"),
    "an animated material": (
        set_at(*CHANNELS, 1, "target", "extensions", "KHR_animation_pointer", "pointer", "/materials/1/a"),
        "pointer",
    ),
    "a camera's lens": (set_at("cameras", 0, "perspective", "yfov", 0.8), "camera 0 > perspective > yfov"),
    "no camera": (drop("nodes", 3, "camera"), "camera: is gone"),
    "another light": (set_at("nodes", 1, "extensions", "KHR_lights_punctual", "light", 1), "light > light 0"),
    "a light's angle": (
        set_at("extensions", "KHR_lights_punctual", "lights", 0, "spot", "outerConeAngle", 0.4),
        "outerConeAngle",
    ),
    "the lights gone": (drop("nodes", 1, "extensions"), "extensions: is gone"),
    "a variant's name": (set_at("extensions", "KHR_materials_variants", "variants", 0, "name", "Pink"), "'Pink'"),
    "variant mappings swapped": (lambda pieces: _at(pieces, *MAPPINGS).reverse(), "mappings[0] > material"),
    "a mapping of another variant": (set_at(*MAPPINGS, 0, "variants", [1]), "mappings[0] > variants[0] > name"),
    "a mapping's material": (set_at(*MAPPINGS, 1, "material", 1), "mappings[1] > material"),
    "instances": (nudge(12), "TRANSLATION"),
    "an unknown extension of a node": (drop("nodes", 2, "extensions", "ACME_door"), "ACME_door: is gone"),
    "an unknown extension of a material": (drop(*PAINT, "extensions", "ACME_rust"), "ACME_rust: is gone"),
    "an unknown extension of the root": (set_at("extensions", "ACME_fleet", "number", 8), "ACME_fleet > number"),
    "an extension's name": (drop("extensionsUsed", 0), "extensionsUsed: KHR_lights_punctual is gone"),
    "an extension required": (set_at("extensionsRequired", 0, "KHR_texture_transform"), "extensionsRequired"),
    "a primitive's material": (set_at(*SHELL, "material", 2), "material > material 0 'Paint' > name"),
    "a primitive without material": (drop(*SHELL, "material"), "material: is gone"),
    "a material's name": (set_at("materials", 1, "name", "Ice"), "material 1 'Glass' > name"),
    "one side": (drop(*PAINT, "doubleSided"), "doubleSided: is gone"),
    "doubleSided flipped": (set_at(*PAINT, "doubleSided", False), "doubleSided: was True, is False"),
    "doubleSided as a number": (set_at(*PAINT, "doubleSided", 1), "doubleSided: was True, is 1"),
    "alpha mode": (set_at("materials", 1, "alphaMode", "MASK"), "alphaMode"),
    "unlit no longer": (drop("materials", 1, "extensions", "KHR_materials_unlit"), "KHR_materials_unlit: is gone"),
    "a factor": (set_at(*PAINT, "pbrMetallicRoughness", "roughnessFactor", 0.41), "roughnessFactor"),
    "another texture": (set_at(*PAINT, "normalTexture", "index", 0), "normalTexture > index > texture 1"),
    "another texture in an extension": (set_at(*CLEARCOAT, "clearcoatTexture", "index", 0), "clearcoatTexture"),
    "a texture's UV set": (set_at(*PAINT, "normalTexture", "texCoord", 0), "texCoord: was 1, is 0"),
    "a texture's transform": (
        drop(*PAINT, "pbrMetallicRoughness", "baseColorTexture", "extensions"),
        "extensions: is gone",
    ),
    "a normal map's scale": (set_at(*PAINT, "normalTexture", "scale", 1), "normalTexture > scale"),
    "a wrap mode": (set_at("samplers", 0, "wrapS", 10497), "sampler 0 > wrapS: was 33071, is 10497"),
    "no sampler": (drop("textures", 0, "sampler"), "sampler: is gone"),
    "a texture's name": (drop("textures", 0, "name"), "texture 0 'Base' > name: is gone"),
    "a texture's byte": (lambda pieces: _flip(pieces, 0), "image 0 'Image 0' > bytes"),
    "a WebP texture's byte": (lambda pieces: _flip(pieces, 2), "image 2 'Image 2' > bytes"),
    "an unused texture's byte": (lambda pieces: _flip(pieces, 3), "image 3 'Image 3': is gone or changed"),
    "an image's name": (set_at("images", 1, "name", "x"), "image 1 'Image 1' > name"),
    "an unused material": (drop("materials", 3), "material 3 'Spare': is gone or changed"),
    "a material more": (lambda pieces: pieces["materials"].append({"name": "x"}), "materials: were 4, are 5"),
    "copyright": (drop("asset", "copyright"), "asset > copyright: is gone"),
    "the generator": (set_at("asset", "generator", "x"), "asset > generator"),
    "an author": (drop("asset", "extras", "author"), "asset > extras > author: is gone"),
}


def _at(pieces: Pieces, *keys: Any) -> Any:
    for key in keys:
        pieces = pieces[key]
    return pieces


def _flip(pieces: Pieces, image: int) -> None:
    pieces["images"][image]["bytes"] = pieces["images"][image]["bytes"][:-1] + b"\xff"


def changed(mutate: Mutate, folder: Path, allowed: Allowed = NOTHING) -> list[str]:
    """The differences that a mutation of the sample makes."""
    pieces = sample_document()
    mutate(pieces)
    before, after = write(sample_document(), folder / "before.glb"), write(pieces, folder / "after.glb")
    return differences(read(before), read(after), allowed)


@pytest.mark.parametrize("name", MUTATIONS)
def test_a_change_is_found_where_it_is(name: str, tmp_path: Path) -> None:
    mutate, words = MUTATIONS[name]
    found = changed(mutate, tmp_path)
    assert any(words in sentence for sentence in found), found


@pytest.mark.parametrize("file", ["other.glb", "other.gltf", "data.gltf"])
@pytest.mark.parametrize("arrange", [separate, interleaved, sparse])
@pytest.mark.parametrize("order", [lambda pieces: pieces, renumbered])
def test_another_packing_is_no_change(file: str, arrange: Any, order: Any, tmp_path: Path) -> None:
    before = write(sample_document(), tmp_path / "before.glb")
    after = write(order(sample_document()), tmp_path / file, arrange)
    assert differences(read(before), read(after)) == []
    assert differences(read(after), read(before)) == []


@pytest.mark.parametrize("name", ["a position", "a texture's byte", "an animated node", "another light", "a joint"])
def test_a_change_is_found_under_another_packing(name: str, tmp_path: Path) -> None:
    pieces = sample_document()
    MUTATIONS[name][0](pieces)
    after = write(renumbered(pieces), tmp_path / "data.gltf", interleaved)
    assert differences(read(write(sample_document(), tmp_path / "before.glb")), read(after))
