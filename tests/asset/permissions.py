"""What an edit may change in a document, and what remains to be compared then."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import Flag, auto
from typing import Any

import numpy as np
from gltf_reader import DRACO, MESHOPT
from jaxtyping import Int, Num, Shaped
from numpy import ndarray
from references import Item

FACTORS = {"anisotropyRotation", "anisotropyStrength", "attenuationColor", "attenuationDistance", "dispersion"} | {
    *("emissiveStrength", "ior", "iridescenceIor", "iridescenceThicknessMaximum", "iridescenceThicknessMinimum"),
}
"""Numbers of materials whose names do not end in Factor."""
COMPRESSIONS = frozenset({DRACO, *MESHOPT})
UV_SET = re.compile(r"TEXCOORD_\d+")
TRIANGLES, STRIP, FAN = 4, 5, 6


class Change(Flag):
    """Kinds of change; the first five concern the allowed materials and what carries them."""

    TEXTURES = auto()  # textures come, go, or show something else
    FACTORS = auto()  # numbers by which textures are multiplied, or which stand alone
    UV_SETS = auto()  # primitives get further TEXCOORD_n, for which vertices may be split
    COLORS = auto()  # vertex colours may be gone, into textures
    COPIES = auto()  # there are more materials and meshes, with a suffix to the name
    STAMP = auto()  # asset.generator may be anything, and asset.extras may have more in it
    DECOMPRESSION = auto()  # extensions that compress geometry may be gone


NO_CHANGE = Change(0)


@dataclass(frozen=True)
class Allowed:
    """The materials that may change, by their names or numbers in the original, and what may.

    None stands for primitives without a material: they may get one.
    """

    materials: frozenset[str | int | None] = frozenset()
    what: Change = NO_CHANGE

    def material(self, item: Item | None) -> bool:
        """Whether this material of the original may change."""
        if item is None:
            return None in self.materials
        return not self.materials.isdisjoint({item.index, item.content.get("name", item.index)})

    def carrier(self, item: Item) -> bool:
        """Whether this is a mesh, or a primitive, of the original with a material that may change."""
        if item.kind == "meshes":
            return any(self.carrier(primitive) for primitive in item.content["primitives"])
        mappings = item.content.get("extensions", {}).get("KHR_materials_variants", {}).get("mappings", [])
        return any(map(self.material, [item.content.get("material"), *(pair["material"] for pair in mappings)]))


NOTHING = Allowed()


def weathering(*materials: str | int | None) -> Allowed:
    """The permission to change these materials in all ways that weathering may."""
    return Allowed(frozenset(materials), ~Change(0))


def left_of_material(content: Mapping[str, Any], what: Change) -> dict[str, Any]:
    """The part of a material that the permission does not cover.

    An object of which the permission covers everything is left out; one that was empty stays, except
    `pbrMetallicRoughness`, which means nothing then.
    """
    left = {}
    for key, value in content.items():
        if (Change.TEXTURES in what and key.endswith("Texture")) or (Change.FACTORS in what and _is_factor(key)):
            continue
        below = left_of_material(value, what) if isinstance(value, dict) and key != "extras" else value
        if below or (below == value and key != "pbrMetallicRoughness"):
            left[key] = below
    return left


def _is_factor(key: str) -> bool:
    return key.endswith("Factor") or key in FACTORS


def extensions_in(item: Any) -> Iterator[str]:
    """The names of all extensions in a piece of a tree."""
    content = item.content if isinstance(item, Item) else item
    if isinstance(content, dict):
        yield from content.get("extensions", {})
        for key, value in content.items():
            yield from extensions_in(value) if key != "extras" else ()
    elif isinstance(content, list):
        for value in content:
            yield from extensions_in(value)


def by_corner(primitive: Mapping[str, Any], kept: Mapping[str, Any]) -> dict[str, Any]:
    """The primitive with its arrays looked up at the corners, so that neither indices nor split vertices matter.

    Strips and fans are taken apart into triangles. Further UV sets than those of the primitive `kept` are left out.
    """
    attributes = primitive["attributes"]
    named = {
        name: item for name, item in attributes.items() if name in kept["attributes"] or not UV_SET.fullmatch(name)
    }
    count = len(next(iter(attributes.values())).content["values"])
    mode = primitive.get("mode", TRIANGLES)
    order = _corners(primitive["indices"].content["values"][:, 0] if "indices" in primitive else np.arange(count), mode)
    rest = {key: value for key, value in primitive.items() if key not in ("indices", "mode", "targets")}
    targets = [_at(target, order) for target in primitive.get("targets", [])]
    kind = TRIANGLES if mode in (STRIP, FAN) else mode
    return {**rest, "mode": kind, "attributes": _at(named, order), "targets": targets}


def _at(attributes: Mapping[str, Item], order: Int[ndarray, " corners"]) -> dict[str, Shaped[ndarray, "corners width"]]:
    return {name: item.content["values"][order] for name, item in attributes.items()}


def _corners(indices: Num[ndarray, " indices"], mode: int) -> Int[ndarray, " corners"]:
    """The vertex of each corner, triangle by triangle, wound as the specification says."""
    order = indices.astype(np.int64)
    if mode == FAN:
        return np.stack([order[1:-1], order[2:], np.full(len(order) - 2, order[0])], axis=1).ravel()
    if mode != STRIP:
        return order
    odd = np.arange(len(order) - 2) % 2
    first = np.arange(len(order) - 2)
    return np.stack([order[first], order[first + 1 + odd], order[first + 2 - odd]], axis=1).ravel()
