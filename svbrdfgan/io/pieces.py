"""Triangles of one material, as files hold them before they are joined to one mesh."""

from __future__ import annotations

from dataclasses import dataclass

from jaxtyping import Float, Int
from numpy import ndarray

from svbrdfgan.types import Part

MAX_FACES = 50_000_000
"""Triangles of one file, each as often as it is shown."""


@dataclass(frozen=True)
class Source:
    """The place of a piece in its glTF document: indices into the header's tables, and the GPU instance or 0.

    Attributes:
        mirrored: whether the node mirrors it, so that the piece's faces run the other way than the document's.
    """

    node: int
    mesh: int
    primitive: int
    instance: int = 0
    mirrored: bool = False


@dataclass(frozen=True, eq=False)
class Piece:
    """Triangles of one material in world coordinates. Parts of different pieces may have the same name.

    Attributes:
        positions: of each vertex of the file's mesh, in its order.
        uv_sets: the file's own UVs, or None, and the further sets that the part's textures are looked up in.
        source: where a glTF document holds it; None for other files.
    """

    positions: Float[ndarray, "vertices 3"]
    faces: Int[ndarray, "faces 3"]
    uv_sets: tuple[Float[ndarray, "vertices 2"] | None, ...]
    part: Part
    source: Source | None = None
