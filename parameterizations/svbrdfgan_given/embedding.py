"""The mesh's own UVs as an embedding: kept if they are one-to-one, repaired if they are not."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from svbrdfgan.errors import ConfigError, EmbeddingError
from svbrdfgan.geometry.normals import face_areas
from svbrdfgan.geometry.split import surface_over
from svbrdfgan.protocols import UVCapabilities
from svbrdfgan.types import Mesh, Surface
from svbrdfgan_given.charts import charts_overlap, find_charts, signed_areas

log = logging.getLogger(__name__)

_HALVINGS = 40  # bisections of the scale, enough for nearly all bits of a double


@dataclass(frozen=True)
class GivenEmbedding:
    """The mesh's own texture coordinates, one-to-one.

    The UVs are kept bit for bit if they lie in the unit square, do not overlap, are not mirrored (counter-clockwise
    faces stay so), and every face with an area has an area in UV. Otherwise, only the repairs that are needed are made.
    Mirrored charts are mirrored in place. Charts in other tiles of a repeating texture are moved by whole tiles. A
    layout that is larger than the square is scaled as a whole. If charts overlap, all are scaled by one factor and
    packed without rotation. A chart that overlaps itself is cut. Faces that are a line or a point in UV get half a
    texel each, in a block that is packed with the charts.

    Attributes:
        resolution: texels along a side; the unit of `gutter`.
        gutter: texels between charts, if they are packed.

    Raises:
        ConfigError: an option is out of range.
    """

    resolution: int = 256
    gutter: float = 2.0

    capabilities: ClassVar[UVCapabilities] = UVCapabilities(injective=True, subdivides=False)

    def __post_init__(self) -> None:
        if not 1 <= self.resolution <= 16384:
            raise ConfigError(f"resolution is {self.resolution}; wanted texels along a side, from 1 to 16384.")
        if not (math.isfinite(self.gutter) and 0.0 <= self.gutter < self.resolution / 2):
            raise ConfigError(f"gutter is {self.gutter}; wanted texels, at least 0 and below half of the resolution.")

    def embed(self, mesh: Mesh) -> Surface:
        """The mesh over its own UVs, which are repaired if they are not one-to-one. Faces are not cut.

        Raises:
            EmbeddingError: the mesh has no UVs, they have no area, or there are too many charts for the resolution.
        """
        if mesh.uv is None:
            raise EmbeddingError("the mesh has no UVs of its own; export it with UVs, or choose another embedding.")
        if not signed_areas(mesh.uv).any():
            raise EmbeddingError("the mesh's own UVs have no area; unwrap it again, or choose another embedding.")
        return _surface(mesh, self._repaired(mesh, mesh.uv))

    def _repaired(self, mesh: Mesh, uv: Float[ndarray, "faces 3 2"]) -> Float[ndarray, "faces 3 2"]:
        chart = find_charts(mesh.faces, uv)
        lost = (chart < 0) & (face_areas(mesh.positions, mesh.faces) > 0.0)
        repaired = _into_tile(_turned_over(uv, chart), chart)
        if lost.any() or charts_overlap(repaired, chart):
            log.info("own UVs: %d charts repacked, %d faces without UV area", chart.max() + 1, lost.sum())
            repaired = self._packed(repaired, chart)
        return np.clip(_into_square(repaired, repaired[chart >= 0]), 0.0, 1.0)

    def _packed(self, uv: Float[ndarray, "faces 3 2"], chart: Int[ndarray, " faces"]) -> Float[ndarray, "faces 3 2"]:
        """The UVs with all charts side by side, and a block of the faces without a chart, two to a texel."""
        texel = 1.0 / self.resolution
        low, high = _boxes(uv, chart)
        lost = np.flatnonzero(chart < 0)
        side = math.ceil(math.sqrt(len(lost) / 2))
        sizes = np.concatenate([high - low, np.zeros((1, 2))])
        fixed = np.concatenate([np.zeros_like(low), np.full((1, 2), side * texel)])
        found = pack(sizes, fixed, self.gutter * texel)
        if found is None or found[0] <= 0.0:
            raise EmbeddingError(
                f"the mesh's own UVs are {len(low)} charts and {len(lost)} faces without area, which do not fit "
                f"{self.resolution} texels with gutters of {self.gutter:g}; raise resolution or lower gutter."
            )
        scale, corners = found
        packed = corners[chart][:, None] + scale * (uv - low[chart][:, None])
        packed[lost] = corners[-1] + texel * _halves(len(lost), side)
        return packed


def _turned_over(uv: Float[ndarray, "faces 3 2"], chart: Int[ndarray, " faces"]) -> Float[ndarray, "faces 3 2"]:
    """The UVs with each mirrored chart mirrored again inside its own bounding box."""
    mirrored = np.bincount(chart[chart >= 0], signed_areas(uv)[chart >= 0]) < 0
    chosen = np.flatnonzero((chart >= 0) & mirrored[chart])
    if not len(chosen):
        return uv
    low, high = _boxes(uv, chart)
    turned = uv.copy()
    turned[chosen, :, 0] = (low + high)[chart[chosen], 0][:, None] - uv[chosen, :, 0]
    return turned


def _into_tile(uv: Float[ndarray, "faces 3 2"], chart: Int[ndarray, " faces"]) -> Float[ndarray, "faces 3 2"]:
    """The UVs with charts moved by whole tiles, so that the middle of each lies in the unit square."""
    low, high = _boxes(uv, chart)
    tile = np.where((low >= 0.0) & (high <= 1.0), 0.0, np.floor((low + high) / 2))
    return np.where((chart >= 0)[:, None, None], uv - tile[chart][:, None], uv) if tile.any() else uv


def _into_square(uv: Float[ndarray, "faces 3 2"], used: Float[ndarray, "used 3 2"]) -> Float[ndarray, "faces 3 2"]:
    """The layout moved, and scaled down if necessary, so that `used` lies in the unit square; unchanged if it does."""
    low, high = used.min(axis=(0, 1)), used.max(axis=(0, 1))
    if low.min() >= 0.0 and high.max() <= 1.0:
        return uv
    return (uv - low) / max(float((high - low).max()), 1.0)


def _boxes(
    uv: Float[ndarray, "faces 3 2"], chart: Int[ndarray, " faces"]
) -> tuple[Float[ndarray, "charts 2"], Float[ndarray, "charts 2"]]:
    """Lower and upper corner of each chart's bounding box."""
    good = chart >= 0
    low = np.full((int(chart.max()) + 1, 2), np.inf)
    high = -low
    np.minimum.at(low, chart[good], uv[good].min(axis=1))
    np.maximum.at(high, chart[good], uv[good].max(axis=1))
    return low, high


def _halves(count: int, side: int) -> Float[ndarray, "faces 3 2"]:
    """Triangles that do not touch, two in each unit cell of a grid that is `side` cells wide."""
    index = np.arange(count)
    corner = np.array([[0.1, 0.1], [0.8, 0.1], [0.1, 0.8]])
    triangle = np.where((index % 2 == 0)[:, None, None], corner, 1.0 - corner)
    cell = index // 2
    return triangle + np.stack([cell % max(side, 1), cell // max(side, 1)], axis=1)[:, None]


def _surface(mesh: Mesh, uv: Float[ndarray, "faces 3 2"]) -> Surface:
    """The surface with exactly these UVs: corners share a vertex only if their UVs are equal to the last bit."""
    rank = np.unique(uv.reshape(-1, 2), axis=0, return_inverse=True)[1].reshape(-1, 3, 1)
    return surface_over(mesh, uv, distinct=rank.astype(np.float64))


def pack(
    sizes: Float[ndarray, "boxes 2"], fixed: Float[ndarray, "boxes 2"], gutter: float
) -> tuple[float, Float[ndarray, "boxes 2"]] | None:
    """The largest common scale found for the sizes, and each box's lower left corner; None if no scale fits.

    `fixed` is added to the scaled sizes. Boxes lie `gutter` apart, and half of that from the square's border.
    """
    # highest first, as a shelf is as high as its highest box
    order = np.lexsort((-sizes[:, 0], -(sizes[:, 1] + fixed[:, 1])))
    area = float(sizes.prod(axis=1).sum())
    # Larger scales cannot fit: the boxes would fill four squares, or the longest side would be 2. All may be points.
    low, high = 0.0, 2.0 / max(area, float(sizes.max()) ** 2, 1e-300) ** 0.5
    best = _shelves(fixed + low * sizes, order, gutter)
    for _ in range(_HALVINGS):
        if best is None:
            break
        middle = (low + high) / 2.0
        found = _shelves(fixed + middle * sizes, order, gutter)
        if found is None:
            high = middle
        else:
            low, best = middle, found
    return None if best is None else (low, best)


def _shelves(sizes: Float[ndarray, "boxes 2"], order: ndarray, gutter: float) -> Float[ndarray, "boxes 2"] | None:
    """Shelf packing: lower left corners, in rows from left to right and upwards; None if the boxes do not fit."""
    corners = np.empty_like(sizes)
    border = 1.0 - gutter / 2.0
    left = bottom = gutter / 2.0
    top = bottom
    for box in order.tolist():
        width, height = sizes[box]
        if left + width > border:
            left, bottom = gutter / 2.0, top + gutter
        if left + width > border or bottom + height > border:
            return None
        corners[box] = left, bottom
        left += width + gutter
        top = max(top, bottom + height)
    return corners
