"""A UV embedding: six views of the mesh, each face in the one that sees it best."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from svbrdfgan.errors import ConfigError, EmbeddingError
from svbrdfgan.geometry.normals import corner_normals, face_normals
from svbrdfgan.geometry.split import surface_from_corners
from svbrdfgan.geometry.subdivide import Pieces
from svbrdfgan.protocols import UVCapabilities
from svbrdfgan.types import Mesh, Surface

# For each view: where it looks from, what is to its right, and what is up. Right x up = from, so nothing is mirrored.
VIEWS = np.array(
    [
        [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
        [[-1, 0, 0], [0, 0, 1], [0, 1, 0]],
        [[0, 1, 0], [1, 0, 0], [0, 0, -1]],
        [[0, -1, 0], [1, 0, 0], [0, 0, 1]],
        [[0, 0, 1], [1, 0, 0], [0, 1, 0]],
        [[0, 0, -1], [-1, 0, 0], [0, 1, 0]],
    ]
)
_COLUMNS, _ROWS = 2, 3


@dataclass(frozen=True)
class CubeEmbedding:
    """The six sides of the mesh's bounding box, two by two: left and right, top and bottom, front and back.

    Attributes:
        margin: empty border of each view, as a share of its cell of the square.

    Raises:
        ConfigError: the margin is out of range.
    """

    margin: float = 0.03

    capabilities: ClassVar[UVCapabilities] = UVCapabilities(injective=False, subdivides=False)

    def __post_init__(self) -> None:
        if not 0.0 <= self.margin < 0.5:
            raise ConfigError(f"margin is {self.margin}; wanted at least 0 and below 0.5.")

    def embed(self, mesh: Mesh) -> Surface:
        """The mesh over the unit square, whole faces.

        Raises:
            EmbeddingError: all of the mesh is one point.
        """
        low, high = mesh.bounds
        if not (high > low).any():
            raise EmbeddingError("the mesh is a single point; a cube embedding needs an extent.")
        facing = face_normals(mesh.positions, mesh.faces) @ VIEWS[:, 0].T
        view = np.argmax(facing, axis=1)
        axes = VIEWS[view]  # of each face: towards the viewer, right, up
        outward, right, up = np.moveaxis(np.einsum("fkx,fax->fka", self._centred(mesh), axes), -1, 0)
        width, height = np.abs(axes[:, 1:] @ (high - low)).T[:, :, None]
        inside = np.stack([_share(right, width), _share(up, height)], axis=-1)
        cell = np.stack([view % _COLUMNS, view // _COLUMNS], axis=1)[:, None, :]
        return surface_from_corners(
            Pieces.whole(mesh.positions, mesh.faces),
            normals=corner_normals(mesh.positions, mesh.faces),
            uv=(cell + self.margin + (1.0 - 2.0 * self.margin) * inside) / (_COLUMNS, _ROWS),
            elevation=outward,
            face_part=mesh.face_part,
            parts=mesh.parts,
        )

    def _centred(self, mesh: Mesh) -> np.ndarray:
        return mesh.positions[mesh.faces] - mesh.bounds.mean(axis=0)


def _share(coordinate: np.ndarray, extent: np.ndarray) -> np.ndarray:
    """From minus to plus half the extent, as 0 to 1; the middle of a mesh that is flat there."""
    return np.clip(0.5 + np.divide(coordinate, extent, out=np.zeros_like(coordinate), where=extent > 0.0), 0.0, 1.0)
