"""Pieces of an asset that weather together: those of one material, which share its textures."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from svbrdfgan.asset.asset import Asset
from svbrdfgan.io.gltf.document import Document, Json
from svbrdfgan.io.gltf.primitives import vertex_colors
from svbrdfgan.io.uv_sets import UVSet


@dataclass(frozen=True, eq=False)
class Group:
    """The weathered pieces of one material.

    Attributes:
        material: its number in the document; None for pieces without one.
        pieces: their numbers.
        faces: their faces in the asset's mesh.
        shared: whether anything else in the document has the material, too.
    """

    asset: Asset
    material: int | None
    pieces: tuple[int, ...]
    faces: Int[ndarray, " faces"]
    shared: bool

    @property
    def name(self) -> str:
        """The material's, or else the name of what has none."""
        return self.asset.pieces[self.pieces[0]].part.name

    @property
    def entry(self) -> Json:
        """The material as the file has it."""
        return {"name": self.name} if self.material is None else self.asset.document.table("materials")[self.material]

    def uv(self, uv_set: UVSet) -> Float[ndarray, "faces 3 2"] | None:
        """The UVs at the corners of the faces; None if one of the pieces has none."""
        made = np.zeros((len(self.asset.mesh.faces), 3, 2))
        for piece in self.pieces:
            uv = self.asset.uv(piece, uv_set.number)
            if uv is None:
                return None
            mine = self.asset.faces(piece)
            made[mine] = uv_set.moved(uv)[self.asset.corner_vertices[mine]]
        return made[self.faces]

    def with_tangents(self) -> Bool[ndarray, " mesh_faces"]:
        """The faces of pieces whose tangents the file has."""
        pieces = [piece for piece in self.pieces if "TANGENT" in self.asset.primitive(piece)["attributes"]]
        return np.isin(self.asset.face_piece, pieces)

    def tinted(self) -> tuple[int, ...]:
        """The pieces whose vertex colours multiply the base colour, and can go into its texture instead.

        Colours that morph, or that tint another material of a variant, cannot.
        """
        return tuple(piece for piece in self.pieces if self._bakes(piece))

    def vertex_colors(self) -> Float[ndarray, "mesh_faces 3 4"] | None:
        """Linear RGBA at the corners of all faces of the mesh, 1 where there is no tint; None if there is none at all.

        The alpha of opaque materials counts as 1.
        """
        pieces = self.tinted()
        if not pieces:
            return None
        made = np.ones((len(self.asset.mesh.faces), 3, 4), np.float32)
        for piece in pieces:
            mine = self.asset.faces(piece)
            made[mine] = self._colors(piece)[self.asset.corner_vertices[mine]]
        return made

    def _bakes(self, piece: int) -> bool:
        primitive = self.asset.primitive(piece)
        morphs = any("COLOR_0" in target for target in primitive.get("targets", []))
        others = {mapping["material"] for mapping in variants(primitive)} - {self.material}
        can = "COLOR_0" in primitive["attributes"] and not morphs and not others
        return can and bool((self._colors(piece) != 1.0).any())

    def _colors(self, piece: int) -> Float[ndarray, "vertices 4"]:
        stored = vertex_colors(self.asset.document, self.asset.primitive(piece))
        made = np.ones((len(stored), 4))
        kept = 3 if self.entry.get("alphaMode", "OPAQUE") == "OPAQUE" else stored.shape[1]
        made[:, :kept] = stored[:, :kept]
        return made


def groups(asset: Asset, weathers: Collection[int]) -> Iterator[Group]:
    """The pieces of these numbers, material by material. Instances beyond the first weather with it."""
    of_material: dict[int | None, list[int]] = {}
    for piece in range(len(asset.pieces)):
        if piece in weathers and asset.source(piece).instance == 0:
            of_material.setdefault(asset.primitive(piece).get("material"), []).append(piece)
    shown = _showings(asset.document)
    for material, pieces in of_material.items():
        faces = np.sort(np.concatenate([asset.faces(piece) for piece in pieces]))
        if len(faces):
            own = {
                (asset.source(piece).node, asset.source(piece).mesh, asset.source(piece).primitive) for piece in pieces
            }
            shared = material is not None and not own.issuperset(shown[material])
            yield Group(asset, material, tuple(pieces), faces, shared)


def free_uv_set(asset: Asset, pieces: Collection[int]) -> int:
    """The number of the first UV set that none of the pieces has."""
    taken = [
        int(key.removeprefix("TEXCOORD_"))
        for piece in pieces
        for key in asset.primitive(piece)["attributes"]
        if key.startswith("TEXCOORD_")
    ]
    return max(taken, default=-1) + 1


def variants(primitive: Json) -> list[Json]:
    """The materials that a primitive has in variants, and in which."""
    found: list[Json] = primitive.get("extensions", {}).get("KHR_materials_variants", {}).get("mappings", [])
    return found


def _showings(document: Document) -> dict[int, list[tuple[int, int, int]]]:
    """For each material all primitives that have it, or one of whose variants does: by node, even outside of the scene
    and -1 if there is none, mesh and number.
    """
    users: dict[int, list[int]] = {}
    for number, node in enumerate(document.table("nodes")):
        users.setdefault(node.get("mesh", -1), []).append(number)
    found: dict[int, list[tuple[int, int, int]]] = {}
    for mesh, entry in enumerate(document.table("meshes")):
        for number, primitive in enumerate(entry["primitives"]):
            for material in {primitive.get("material"), *(mapping["material"] for mapping in variants(primitive))}:
                places = found.setdefault(material, [])
                places += [(node, mesh, number) for node in users.get(mesh, [-1])]
    return found
