"""Charts: the disk that is flattened for a mesh (the mesh itself or a wrap), with its UVs in the unit square."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from svbrdfgan.errors import EmbeddingError
from svbrdfgan.types import Mesh
from svbrdfgan_igl.cut_to_disk import cut_to_disk, is_one_surface
from svbrdfgan_igl.flatten import TOO_THIN, Boundary, Flatten, one_to_one, packed
from svbrdfgan_igl.topology import Disk
from svbrdfgan_igl.wrap import wrap

# positions are rounded to this fraction of the size, so that the map does not depend on the mesh's place and unit
_STEPS = 1 << 30
_WRAP_FACES = 6000


@dataclass(frozen=True, eq=False)
class UnitFrame:
    """Coordinates in which the mesh's longest side is 1 and its lower corner is at the origin."""

    low: Float[ndarray, " 3"]
    size: float

    @classmethod
    def of(cls, mesh: Mesh) -> UnitFrame:
        """The frame of a mesh.

        Raises:
            EmbeddingError: the mesh is a point, or too small for its distance from the origin in double precision.
        """
        low, high = mesh.bounds
        size = float((high - low).max())
        if size <= 1e-12 * np.abs(mesh.bounds).max():
            raise EmbeddingError(f"the mesh is {size:.3g} m in size; an embedding needs a surface with an area.")
        return cls(low, size)

    def to_unit(self, points: Float[ndarray, "*n 3"]) -> Float[ndarray, "*n 3"]:
        """Points in metres, converted to these coordinates and rounded."""
        return np.asarray(np.round((points - self.low) / self.size * _STEPS) / _STEPS)


@dataclass(frozen=True, eq=False)
class Chart:
    """A disk with UVs in the unit square.

    Attributes:
        disk: the surface, in the coordinates of `frame`.
        uv: UVs of its vertices, in [0, 1]; no triangle is flipped and none overlaps another.
        is_wrap: True if the disk surrounds the mesh; False if its faces are those of the mesh, in the same order.
    """

    disk: Disk
    uv: Float[ndarray, "vertices 2"]
    frame: UnitFrame
    is_wrap: bool


def chart_of(mesh: Mesh, flatten: Flatten, boundary: Boundary, seams: int | None, margin: float, cells: int) -> Chart:
    """See `StretchEmbedding.chart`."""
    frame = UnitFrame.of(mesh)
    used, index = np.unique(mesh.faces, return_inverse=True)
    positions, weld = np.unique(frame.to_unit(mesh.positions[used]), axis=0, return_inverse=True)
    faces = weld.reshape(-1)[index.reshape(-1, 3)].astype(np.int64)
    is_wrap = not is_one_surface(positions, faces)
    disk = _wrapped(positions, faces, cells, seams) if is_wrap else cut_to_disk(positions, faces, seams)[0]
    uv = flatten(disk, boundary, margin)
    if not one_to_one(disk, uv):
        raise EmbeddingError(TOO_THIN)
    return Chart(disk, packed(uv, margin), frame, is_wrap)


def _wrapped(
    positions: Float[ndarray, "vertices 3"], faces: Int[ndarray, "faces 3"], cells: int, seams: int | None
) -> Disk:
    disk = wrap(positions, faces, cells, _WRAP_FACES)
    return cut_to_disk(disk.positions, disk.faces, seams)[0] if seams else disk
