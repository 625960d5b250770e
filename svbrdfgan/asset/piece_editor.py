"""New materials and UV sets for the primitives of a document, of which others may show copies."""

from __future__ import annotations

import copy
from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from svbrdfgan.asset.asset import Asset
from svbrdfgan.asset.piece_groups import Group, variants
from svbrdfgan.io.gltf.accessors import append_accessor, read_accessor
from svbrdfgan.io.gltf.document import Document, Json
from svbrdfgan.io.gltf_codecs.plain import INDICES
from svbrdfgan.io.rows import merge_rows


@dataclass(frozen=True, eq=False)
class NewUVSet:
    """A UV set for some pieces: its number, their faces in the asset's mesh in their order, and UVs at the corners."""

    number: int
    faces: Int[ndarray, " faces"]
    uv: Float[ndarray, "faces 3 2"]


@dataclass(frozen=True, eq=False)
class PieceEditor:
    """Changes the document's entries of an asset's pieces.

    Attributes:
        document: under change; the asset's own stays as it was.
        told: gets a sentence for each thing that is copied or leaves.
    """

    document: Document
    asset: Asset
    told: list[str]

    def assign(self, group: Group, material: Json, uv_set: NewUVSet | None) -> int:
        """Gives the pieces a material that holds their vertex colours: in place of the old if all its pieces weather,
        else as a copy. Meshes of which other nodes show the old state are copied, too. Returns the material's number.
        """
        tinted = group.tinted()
        number = self._material(group, material)
        for piece in group.pieces:
            primitive = self._own_primitive(piece, alone=uv_set is None and number == group.material)
            primitive["material"] = number
            for mapping in variants(primitive):
                if mapping["material"] == group.material:
                    mapping["material"] = number
            if piece in tinted:
                primitive["attributes"].pop("COLOR_0", None)  # gone already if two nodes show the primitive
            if uv_set is not None:
                self._add_uv(piece, primitive, uv_set)
        if tinted:
            self.told.append(f"'{group.name}' has its vertex colours in its texture, for they would tint the layer.")
        return number

    def add_uv_set(self, pieces: Collection[int], uv_set: NewUVSet) -> None:
        """Gives pieces a further UV set. Meshes that other nodes show are copied."""
        for piece in pieces:
            self._add_uv(piece, self._own_primitive(piece, alone=False), uv_set)

    def _material(self, group: Group, material: Json) -> int:
        """The number of the new material."""
        if group.material is not None and not group.shared:
            self.document.table("materials")[group.material] = material
            return group.material
        if group.shared:
            self.told.append(f"'{group.name}' is copied: some of its parts are kept.")
            material = {**material, "name": f"{material.get('name', group.name)} weathered"}
        return self.document.add("materials", material)

    def _own_primitive(self, piece: int, *, alone: bool) -> Json:
        """The document's primitive of a piece; of a copy of its mesh, if other nodes show that mesh and must differ."""
        document, source = self.document, self.asset.source(piece)
        node = document.table("nodes")[source.node]
        if not alone and self._users[node["mesh"]] > 1:
            self._users[node["mesh"]] -= 1
            mesh = copy.deepcopy(document.table("meshes")[node["mesh"]])
            node["mesh"] = document.add("meshes", mesh)
            self._users[node["mesh"]] = 1
            self.told.append(f"'{mesh.get('name', 'a mesh')}' is copied for a node that must differ from others.")
        primitive: Json = document.table("meshes")[node["mesh"]]["primitives"][source.primitive]
        return primitive

    @cached_property
    def _users(self) -> Counter[int]:
        """How many nodes show each mesh."""
        return Counter(node["mesh"] for node in self.document.table("nodes") if "mesh" in node)

    def _add_uv(self, piece: int, primitive: Json, uv_set: NewUVSet) -> None:
        """Gives a primitive a further UV set, for which vertices are split; all its other arrays are gathered anew."""
        number, mine = uv_set.number, self.asset.faces(piece)
        uv = uv_set.uv[np.searchsorted(uv_set.faces, mine)]
        vertex = self.asset.corner_vertices[mine].reshape(-1)
        # glTF's origin is at the upper left
        rows, corner = merge_rows(np.column_stack([vertex, uv.reshape(-1, 2) * (1.0, -1.0) + (0.0, 1.0)]))
        source = rows[:, 0].astype(np.int64)
        primitive["attributes"] = self._gathered(primitive["attributes"], source)
        for lower in range(number):  # sets are numbered without gaps; where there is none, viewers take (0, 0)
            if f"TEXCOORD_{lower}" not in primitive["attributes"]:
                zeros = {"componentType": 5126, "count": len(rows), "type": "VEC2"}
                primitive["attributes"][f"TEXCOORD_{lower}"] = self.document.add("accessors", zeros)
        primitive["attributes"][f"TEXCOORD_{number}"] = append_accessor(self.document, rows[:, 1:].astype("<f4"))
        if "targets" in primitive:
            primitive["targets"] = [self._gathered(target, source) for target in primitive["targets"]]
        faces = corner.reshape(-1, 3)
        if self.asset.source(piece).mirrored:
            faces = faces[:, ::-1]
        primitive["indices"] = append_accessor(self.document, faces.reshape(-1).astype("<u4"), target=INDICES)
        primitive.pop("mode", None)

    def _gathered(self, attributes: Json, source: Int[ndarray, " vertices"]) -> Json:
        made: dict[str, Any] = {}
        for name, index in attributes.items():
            entry = self.document.table("accessors")[index]
            values = read_accessor(self.document, index)[source]
            keys = {key: entry[key] for key in ("normalized", "name", "extras") if key in entry}
            made[name] = append_accessor(self.document, values, bounds=name == "POSITION", **keys)
        return made
