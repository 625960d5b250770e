"""Both states of a weathered document as KHR_materials_variants: clean and weathered."""

from __future__ import annotations

import copy
from collections.abc import Collection, Iterable

from svbrdfgan.asset.piece_groups import Group
from svbrdfgan.io.gltf.document import Document, Json

_EXTENSION = "KHR_materials_variants"
_CLEAN, _WEATHERED = 0, 1


def has_variants(document: Document) -> bool:
    """Whether the document lists variants of its own."""
    return _EXTENSION in document.header.get("extensions", {})


def list_variants(document: Document, weathered: Iterable[Group], materials: Collection[int]) -> list[str]:
    """Lists the variants in a document whose groups have been weathered; primitives show the weathered one.

    Args:
        materials: the numbers of weathered materials.

    Returns:
        A sentence for each group that has no clean variant.
    """
    told = []
    for group in weathered:
        primitives = [_primitive(document, group, piece) for piece in group.pieces]
        number = primitives[0].get("material")
        if number not in materials:
            continue
        if group.tinted():
            told.append(f"'{group.name}' has no clean variant: its vertex colours are in its weathered texture.")
            continue
        clean = group.material if group.shared else document.add("materials", copy.deepcopy(group.entry))
        for primitive in primitives:
            pairs = ((clean, _CLEAN), (number, _WEATHERED))
            mappings = [{"material": material, "variants": [variant]} for material, variant in pairs]
            primitive.setdefault("extensions", {})[_EXTENSION] = {"mappings": mappings}
    names = [{"name": "clean"}, {"name": "weathered"}]
    document.header.setdefault("extensions", {})[_EXTENSION] = {"variants": names}
    document.header.setdefault("extensionsUsed", []).append(_EXTENSION)
    return told


def _primitive(document: Document, group: Group, piece: int) -> Json:
    source = group.asset.source(piece)
    mesh = document.table("meshes")[document.table("nodes")[source.node]["mesh"]]
    primitive: Json = mesh["primitives"][source.primitive]
    return primitive
