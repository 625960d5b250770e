"""The triangles of a glTF document, piece by piece: each primitive as often as nodes show it."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan.errors import AssetError
from svbrdfgan.io.files import parsing
from svbrdfgan.io.gltf.accessors import Matrix
from svbrdfgan.io.gltf.document import Document, Json
from svbrdfgan.io.gltf.materials import DocumentPictures, look_of
from svbrdfgan.io.gltf.nodes import Placement, placements, world_matrices
from svbrdfgan.io.gltf.primitives import (
    count_triangles,
    is_solid,
    morphed_positions,
    skin_matrices,
    skinned_positions,
    texture_coordinates,
    triangles,
    vertex_colors,
)
from svbrdfgan.io.materials import Look, Pictures
from svbrdfgan.io.pieces import MAX_FACES, Piece, Source
from svbrdfgan.io.uv_sets import UVSet
from svbrdfgan.types import Part

log = logging.getLogger(__name__)


def document_pieces(document: Document) -> list[Piece]:
    """One piece for each primitive with faces and each time that a node shows it, ordered by mesh, primitive and place.

    Raises:
        AssetError: accessors, nodes or indices are broken, all meshes are points and lines, or more faces are shown
            than `MAX_FACES`.
    """
    with parsing(document.path, "glTF"):
        places = placements(document)
        if (count := _count(document, places)) > MAX_FACES:
            raise AssetError(f"{document.path} holds {count} faces; wanted a mesh of 1 to {MAX_FACES} triangles.")
        return _pieces(document, places)


def _pieces(document: Document, places: Sequence[Placement]) -> list[Piece]:
    shown: dict[int, list[Placement]] = {}
    for place in sorted(places, key=lambda place: (place.mesh, place.matrix.tolist())):
        shown.setdefault(place.mesh, []).append(place)
    meshes = document.table("meshes")
    solid = [
        (mesh, number)
        for mesh in shown
        for number, primitive in enumerate(meshes[mesh]["primitives"])
        if is_solid(primitive)
    ]
    if shown and not solid:
        raise AssetError(f"{document.path} holds only points or lines, no faces; export it as a mesh.")
    builder = _Builder(document)
    return [
        piece for mesh, number in solid for piece in builder.pieces(mesh, number, shown[mesh], alone=len(solid) == 1)
    ]


def count_shown(document: Document) -> int:
    """About as many triangles as the pieces have together, found before any is read.

    Raises:
        AssetError: nodes or accessors are broken.
    """
    with parsing(document.path, "glTF"):
        return _count(document, placements(document))


def _count(document: Document, places: Sequence[Placement]) -> int:
    meshes = document.table("meshes")
    return sum(
        times * count_triangles(document, primitive)
        for mesh, times in Counter(place.mesh for place in places).items()
        for primitive in meshes[mesh]["primitives"]
        if is_solid(primitive)
    )


class _Builder:
    """Makes pieces of a document, each picture once."""

    def __init__(self, document: Document) -> None:
        self.document = document
        self.pictures, self.decoded = DocumentPictures(document), Pictures(document.path)
        self._looks: dict[int, Look] = {}

    @cached_property
    def world(self) -> dict[int, Matrix]:
        """Of each node, which skins ask for."""
        return dict(world_matrices(self.document))

    def pieces(self, mesh: int, number: int, places: Sequence[Placement], *, alone: bool) -> Iterator[Piece]:
        """A primitive as each placement shows it; what they share is decoded once, and in memory once."""
        entry = self.document.table("meshes")[mesh]
        primitive, stored = entry["primitives"][number], entry.get("name")
        name = stored if isinstance(stored, str) and stored and not alone else self.document.path.stem
        look, faces = self._look(primitive, name), triangles(self.document, primitive)
        resting = morphed_positions(self.document, primitive, entry)
        own = texture_coordinates(self.document, primitive, 0)
        uv_sets = (own, *(self._further(primitive, uv_set, len(resting)) for uv_set in look.further))
        for place in places:
            positions, mirrored = self._placed(place, primitive, resting)
            source = Source(place.node, mesh, number, place.instance, mirrored)
            yield Piece(positions, faces[:, ::-1] if mirrored else faces, uv_sets, look.part, source)

    def _placed(
        self, place: Placement, primitive: Json, positions: Float[ndarray, "vertices 3"]
    ) -> tuple[Float[ndarray, "vertices 3"], bool]:
        """Positions in the world, and whether they are mirrored, which reverses the winding, as glTF specifies."""
        node, matrix = self.document.table("nodes")[place.node], place.matrix
        if "skin" in node:  # glTF ignores the node's own transform
            skin = skin_matrices(self.document, self.document.table("skins")[node["skin"]], self.world)
            positions, matrix = skinned_positions(self.document, primitive, positions, skin), np.eye(4)
        mirrored = bool(np.isfinite(matrix).all() and np.linalg.det(matrix[:3, :3]) < 0)
        return positions @ matrix[:3, :3].T + matrix[:3, 3], mirrored

    def _look(self, primitive: Json, name: str) -> Look:
        if "material" in primitive:
            number = primitive["material"]
            if number not in self._looks:  # else its textures would be in memory for each primitive
                material = self.document.table("materials")[number]
                self._looks[number] = look_of(self.pictures, self.decoded, "", material)
            look = self._looks[number]
            return look if look.part.name else replace(look, part=replace(look.part, name=name))
        if "COLOR_0" not in primitive["attributes"]:
            return Look(Part(name))
        log.info("%s: colours of single vertices are averaged over '%s'", self.document.path, name)
        red, green, blue = vertex_colors(self.document, primitive)[:, :3].mean(axis=0).tolist()
        return Look(Part(name, (red, green, blue)))

    def _further(self, primitive: Json, uv_set: UVSet, vertices: int) -> Float[ndarray, "vertices 2"]:
        """The coordinates that a texture is looked up at; zeros, with a warning, if the primitive lacks the set."""
        uv = texture_coordinates(self.document, primitive, uv_set.number)
        if uv is None:
            log.warning("%s has a texture over TEXCOORD_%d, which its mesh lacks", self.document.path, uv_set.number)
            uv = np.zeros((vertices, 2))
        return uv_set.moved(uv)
