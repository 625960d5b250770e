"""The two embeddings, least-squares conformal and least stretch. Both flatten only the outer surface."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from svbrdfgan.errors import ConfigError
from svbrdfgan.geometry.normals import corner_normals
from svbrdfgan.geometry.split import surface_from_corners
from svbrdfgan.geometry.subdivide import Pieces
from svbrdfgan.protocols import UVCapabilities
from svbrdfgan.types import Mesh, Surface
from svbrdfgan_igl.chart import Chart, chart_of
from svbrdfgan_igl.cut_to_disk import MOST_SEAMS
from svbrdfgan_igl.flatten import Boundary, Flatten, conformal, least_stretch
from svbrdfgan_igl.uv_transfer import WrapLocator, transfer_uv

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class _Options:
    """The options of both embeddings; see `StretchEmbedding`."""

    resolution: int = 256
    boundary: Boundary = "free"
    seams: int | None = None
    gutter: float = 1.0
    cells: int = 96

    capabilities: ClassVar[UVCapabilities] = UVCapabilities(injective=False, subdivides=True)
    _flatten: ClassVar[Flatten]

    def __post_init__(self) -> None:
        if not 1 <= self.resolution <= 16384:
            raise ConfigError(f"resolution is {self.resolution}; wanted texels along a side, from 1 to 16384.")
        if self.boundary not in ("free", "square", "disk"):
            raise ConfigError(f"boundary is {self.boundary!r}; wanted 'free', 'square' or 'disk'.")
        if self.seams is not None and not 0 <= self.seams <= MOST_SEAMS:
            raise ConfigError(f"seams is {self.seams}; wanted None, or a number from 0 to {MOST_SEAMS}.")
        if not (math.isfinite(self.gutter) and 0.0 <= self.gutter <= self.resolution / 8):
            raise ConfigError(f"gutter is {self.gutter}; wanted texels, from 0 to an eighth of resolution.")
        if not 16 <= self.cells <= 512:
            raise ConfigError(f"cells is {self.cells}; wanted voxels along the longest side, from 16 to 512.")

    def chart(self, mesh: Mesh) -> Chart:
        """The flattened surface with its UVs: the mesh itself if it is one manifold, else a wrap.

        Raises:
            EmbeddingError: there is no such surface, or it cannot be flattened.
        """
        margin = self.gutter / self.resolution
        return chart_of(mesh, type(self)._flatten, self.boundary, self.seams, margin, self.cells)

    def embed(self, mesh: Mesh) -> Surface:
        """The mesh over the unit square; subdivided if its UVs are transferred from a wrap.

        Raises:
            EmbeddingError: the mesh has no outer surface that can be flattened.
        """
        chart = self.chart(mesh)
        if chart.is_wrap:
            pieces, uv, elevation = transfer_uv(WrapLocator.of(chart), mesh, self.resolution)
        else:
            pieces = Pieces.whole(mesh.positions, mesh.faces)
            uv, elevation = chart.uv[chart.disk.faces], np.zeros((len(mesh.faces), 3))
        log.info("%s: %d faces became %d", type(self).__name__, len(mesh.faces), len(pieces.faces))
        return surface_from_corners(
            pieces,
            normals=pieces.interpolate(corner_normals(mesh.positions, mesh.faces)),
            uv=uv,
            elevation=elevation,
            face_part=mesh.face_part[pieces.source_face],
            parts=mesh.parts,
        )


@dataclass(frozen=True)
class StretchEmbedding(_Options):
    """The outer surface with the least L2 stretch (Sander et al. 2001), without flips or overlaps.

    A mesh that is one manifold surface is flattened itself: it is cut open if it is closed or has handles or several
    holes, and then further until its stretch is at most 1.15. Any other mesh, such as most vehicles, gets a wrap: a
    disk around all of it, open at the ground. The wrap is flattened, and its UVs are transferred to the mesh.
    `v` runs from the nose (+Z) to the tail and `u` from the vehicle's right to its left, so that vehicles share one
    layout and outer faces keep their winding. Elevation grows outwards.

    Attributes:
        resolution: texels along a side. Faces are cut until interpolating UV errs by about half a texel, or pieces are
            about as small as a texel.
        boundary: "free" fills most of the square as far as that costs little stretch; "square" fills all of it; "disk"
            fills a disk.
        seams: number of further cuts to the places of greatest stretch. None adds none to wraps and open disks, and as
            many as needed to closed surfaces.
        gutter: texels kept free between the chart and the square's border, and between the two sides of a seam.
        cells: voxels of the wrap along the longest side. Gaps narrower than a few of these are bridged.

    Raises:
        ConfigError: an option is out of range.
    """

    _flatten: ClassVar[Flatten] = staticmethod(least_stretch)


@dataclass(frozen=True)
class LscmEmbedding(_Options):
    """The outer surface by the least-squares conformal map (Levy et al. 2002), which keeps angles rather than areas.

    The map is then scaled along u and v to fill the square, so that texels have one shape that is not square.

    If that map flips or overlaps triangles, the conformal energy of Hormann and Greiner (2000) is minimised instead,
    without flips and overlaps. Surfaces, layout and options are those of `StretchEmbedding`; a free boundary takes the
    shape that follows from the angles.

    Raises:
        ConfigError: an option is out of range.
    """

    _flatten: ClassVar[Flatten] = staticmethod(conformal)
