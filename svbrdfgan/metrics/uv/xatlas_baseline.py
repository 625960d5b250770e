"""xatlas, a common UV unwrapper, as a baseline for embeddings. Optional: `pip install xatlas`."""

from __future__ import annotations

import importlib
import importlib.util
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from svbrdfgan.errors import EmbeddingError, PluginError
from svbrdfgan.geometry.normals import corner_normals
from svbrdfgan.geometry.split import surface_from_corners
from svbrdfgan.geometry.subdivide import Pieces
from svbrdfgan.protocols import UVCapabilities
from svbrdfgan.types import Mesh, Surface

NAME = "xatlas"


def xatlas_installed() -> bool:
    """Whether xatlas is installed; does not import it."""
    return importlib.util.find_spec(NAME) is not None


@dataclass(frozen=True)
class XatlasBaseline:
    """xatlas with its default options: many small, packed charts of low distortion. It is not meant for training.

    Raises:
        PluginError: xatlas is not installed.
    """

    capabilities: ClassVar[UVCapabilities] = UVCapabilities(injective=True, subdivides=False)

    def __post_init__(self) -> None:
        if not xatlas_installed():
            raise PluginError("xatlas is not installed; pip install xatlas.")

    def embed(self, mesh: Mesh) -> Surface:
        """The whole mesh with UVs by xatlas.

        Raises:
            EmbeddingError: xatlas returns a different number of faces.
        """
        unwrap = importlib.import_module(NAME).parametrize
        _, corner, uv = unwrap(mesh.positions.astype(np.float32), mesh.faces.astype(np.uint32))
        if corner.shape != mesh.faces.shape:
            raise EmbeddingError(f"xatlas gave {len(corner)} faces for {len(mesh.faces)}; mend the mesh.")
        return surface_from_corners(
            Pieces.whole(mesh.positions, mesh.faces),
            normals=corner_normals(mesh.positions, mesh.faces),
            uv=uv.astype(np.float64)[corner],
            elevation=np.zeros(mesh.faces.shape),
            face_part=mesh.face_part,
            parts=mesh.parts,
        )
