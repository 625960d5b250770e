"""A user's file as a whole: its glTF document, and the triangles that this document shows."""

from __future__ import annotations

import os
from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from svbrdfgan.errors import AssetError
from svbrdfgan.io.files import check_file
from svbrdfgan.io.gltf.document import SUFFIXES as DOCUMENTS
from svbrdfgan.io.gltf.document import Document, Json, read_document
from svbrdfgan.io.gltf.pieces import count_shown, document_pieces
from svbrdfgan.io.gltf.primitives import texture_coordinates
from svbrdfgan.io.gltf.surface_files import mesh_document
from svbrdfgan.io.mesh import SUFFIXES, Joined, join_pieces, load_mesh
from svbrdfgan.io.pieces import Piece, Source
from svbrdfgan.io.rows import members
from svbrdfgan.types import Mesh
from svbrdfgan.utils.memory import require_memory

BYTES_PER_TRIANGLE = 3000
"""What an asset, its surroundings and a second UV set take."""


@dataclass(frozen=True, eq=False)
class Asset:
    """A document, and one welded mesh of all that it shows, in the file's own axes.

    Attributes:
        pieces: each primitive of the document as often as a node shows it. Parts of the mesh are materials; a piece is
            finer.
        joined: the mesh, and the piece and its face that each of the mesh's faces comes from.
    """

    path: Path
    document: Document
    pieces: tuple[Piece, ...]
    joined: Joined

    @property
    def mesh(self) -> Mesh:
        return self.joined.mesh

    @property
    def face_piece(self) -> Int[ndarray, " faces"]:
        """Index into `pieces` of each face of the mesh."""
        return self.joined.piece

    def without(self, pieces: Collection[int]) -> Asset:
        """The asset whose mesh lacks the faces of these pieces, which stay in the document and keep their numbers."""
        if not pieces:
            return self
        nothing = np.zeros((0, 3), np.int64)
        rest = [replace(p, faces=nothing) if k in pieces else p for k, p in enumerate(self.pieces)]
        return replace(self, pieces=tuple(rest), joined=join_pieces(self.path, rest))

    def source(self, piece: int) -> Source:
        """Where the document holds a piece."""
        source = self.pieces[piece].source
        assert source is not None  # all pieces come from a document
        return source

    def primitive(self, piece: int) -> Json:
        """The document's entry of a piece."""
        source = self.source(piece)
        entry: Json = self.document.table("meshes")[source.mesh]["primitives"][source.primitive]
        return entry

    def material(self, piece: int) -> Json | None:
        """The document's material of a piece."""
        number = self.primitive(piece).get("material")
        return None if number is None else self.document.table("materials")[number]

    @cached_property
    def corner_vertices(self) -> Int[ndarray, "faces 3"]:
        """For each corner of the mesh's faces, the vertex of its primitive."""
        starts = np.cumsum([0] + [len(piece.faces) for piece in self.pieces])[:-1]
        return np.concatenate([piece.faces for piece in self.pieces])[starts[self.face_piece] + self.joined.piece_face]

    def faces(self, piece: int) -> Int[ndarray, " faces"]:
        """The mesh's faces that come from a piece, in their order."""
        return self._faces[piece]

    @cached_property
    def _faces(self) -> list[Int[ndarray, " faces"]]:
        return members(self.face_piece, len(self.pieces))

    def uv(self, piece: int, number: int) -> Float[ndarray, "vertices 2"] | None:
        """TEXCOORD_n of a piece's vertices, origin at the lower left; None if it has none."""
        return texture_coordinates(self.document, self.primitive(piece), number)

    def node_names(self, piece: int) -> tuple[str, ...]:
        """Names of the nodes above a piece, outermost first, and of its own; unnamed nodes are left out."""
        nodes, path = self.document.table("nodes"), [self.source(piece).node]
        while path[-1] in self._parents:
            path.append(self._parents[path[-1]])
        names = (nodes[node].get("name") for node in reversed(path))
        return tuple(name for name in names if isinstance(name, str) and name)

    @cached_property
    def _parents(self) -> dict[int, int]:
        nodes = self.document.table("nodes")
        return {child: parent for parent, node in enumerate(nodes) for child in node.get("children", [])}


def load_asset(path: str | os.PathLike[str]) -> Asset:
    """The asset in a mesh file: glTF as it is, and OBJ, PLY and STL as the document that a GLB of them would hold.

    Raises:
        AssetError: the file is missing, broken or of another kind, has no faces, or has invalid coordinates, or shows
            more triangles than the memory holds that may be taken.
    """
    path = check_file(path, SUFFIXES, "mesh")
    document = read_document(path) if path.suffix.lower() in DOCUMENTS else mesh_document(path, load_mesh(path))
    count = count_shown(document)
    needs = f"{path} shows {count:,} triangles, which need"
    require_memory(needs, BYTES_PER_TRIANGLE * count, instead="make it simpler", error=AssetError)
    pieces = document_pieces(document)
    return Asset(path, document, tuple(pieces), join_pieces(path, pieces))
