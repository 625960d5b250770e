"""A workpiece as a generator sees it: embedded, in peels, with what finds the texels of any point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray
from scipy.spatial import cKDTree
from torch import Tensor

from svbrdfgan.asset.peels import Peel, peels
from svbrdfgan.asset.subfaces import SubFaces
from svbrdfgan.geometry.layers import embed_and_rasterize
from svbrdfgan.geometry.tangents import Tangents, corner_tangents
from svbrdfgan.inference.peel_layers import mesh_map_inputs
from svbrdfgan.inference.workpiece import Workpiece
from svbrdfgan.protocols import UVEmbedding
from svbrdfgan.types import Surface

_REACH = 1.5  # texels: a tap shows a point's surface if it lies within what so many texels span there
_NEIGHBOURS = 8
_NEAR, _FAR = 0.1, 3.0  # of the model's size over the number of texels along a side: bounds of that distance

Nearest = tuple[Float[ndarray, "points near"], Int[ndarray, "points near"]]


@dataclass(frozen=True, eq=False)
class EmbeddedPeels:
    """All that draws on a workpiece share.

    Attributes:
        surface: embedded.
        tangents: of its corners.
        peels: the outermost first.
        inputs: what a generator reads of each.
        taps: position of each texel of each peel, metres; NaN where it has nothing of its own.
        reach: of each face of the surface: how far off a tap may be, metres.
        side: of each face of the surface, -1 if it is seen from the side that its winding calls the back.
        tree, tree_tap, tap_normals: the taps that show something, in space; their places in `taps`; their normals.
        remembered: what `nearest` found for points that may be asked for again; None if it shall forget.
    """

    surface: Surface
    tangents: Tangents
    peels: Sequence[Peel]
    inputs: Sequence[Float[Tensor, "inputs rows cols"]]
    subfaces: SubFaces
    taps: Float[ndarray, "peels texels 3"]
    reach: Float[ndarray, " faces"]
    side: Float[ndarray, " faces"]
    tree: cKDTree = field(repr=False)
    tree_tap: Int[ndarray, " known"]
    tap_normals: Float[ndarray, "known 3"]
    remembered: dict[object, Nearest] | None = field(default=None, repr=False)

    @classmethod
    def of(cls, workpiece: Workpiece, embedding: UVEmbedding, texels: int, mesh_maps: bool) -> EmbeddedPeels:
        """Embeds the workpiece's mesh.

        Args:
            texels: along a side.
            mesh_maps: whether generators read them.

        Raises:
            EmbeddingError: the mesh cannot be embedded.
        """
        fragments, surroundings = embed_and_rasterize(embedding, workpiece.mesh, texels), workpiece.surroundings
        wanted = np.isin(workpiece.asset.face_piece, list(workpiece.weathered)) & surroundings.seen()
        surface, found = fragments.surface, list(peels(fragments, wanted, surroundings.reversed))
        inputs = [peel.buffer.network_input() for peel in found]
        if mesh_maps:
            read = mesh_map_inputs(surface, found, surroundings)
            inputs = [torch.cat(both) for both in zip(inputs, read, strict=True)]
        taps = np.stack([peel.positions.reshape(-1, 3) for peel in found])
        normals = np.stack([peel.buffer.normal.numpy().reshape(-1, 3) for peel in found])
        known = np.flatnonzero(np.isfinite(taps[..., 0]).ravel())
        return cls(
            surface,
            corner_tangents(surface),
            found,
            inputs,
            SubFaces.of(surface, len(workpiece.mesh.faces)),
            taps,
            _reach(surface, max(found[0].known.shape)),
            np.where(surroundings.reversed[surface.source_face], -1.0, 1.0),
            cKDTree(taps.reshape(-1, 3)[known]),
            known,
            normals.reshape(-1, 3)[known],
        )

    @cached_property
    def outermost(self) -> EmbeddedPeels:
        """The same without the peels beneath: what they show takes the nearest texels in space."""
        rows, cols = self.shape
        first = self.tree_tap < rows * cols
        return replace(
            self,
            peels=self.peels[:1],
            inputs=self.inputs[:1],
            taps=self.taps[:1],
            tree=cKDTree(np.asarray(self.tree.data)[first]),
            tree_tap=self.tree_tap[first],
            tap_normals=self.tap_normals[first],
            remembered={},
        )

    def nearest(self, position: Float[ndarray, "points 3"], normal: Float[ndarray, "points 3"]) -> Nearest:
        """The taps nearest to points, most of those that face the same way (Franke and Nielson 1980).

        Args:
            normal: of the side that is seen.

        Returns:
            The weights, which sum to 1, and the taps' places among those of all peels.
        """
        if self.remembered is None:
            return self._nearest(position, normal)
        key = len(position), hash(position.tobytes()), hash(normal.tobytes())
        if key not in self.remembered:
            self.remembered[key] = self._nearest(position, normal)
        return self.remembered[key]

    def _nearest(self, position: Float[ndarray, "points 3"], normal: Float[ndarray, "points 3"]) -> Nearest:
        count = min(_NEIGHBOURS + 1, len(self.tree_tap))
        distance, near = self.tree.query(position, k=range(1, count + 1))
        furthest = np.maximum(distance[:, -1:], 1e-9)
        alike = np.maximum(np.einsum("pk,pnk->pn", normal, self.tap_normals[near]), 0.0)
        weight = (1.0 - distance / furthest) ** 2 * (alike**2 + 1e-3)
        weight /= np.maximum(weight.sum(axis=1, keepdims=True), 1e-30)
        return weight, self.tree_tap[near]

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of each peel."""
        rows, cols = self.peels[0].known.shape
        return rows, cols


def _reach(surface: Surface, texels: int) -> Float[ndarray, " faces"]:
    """By the greatest stretch along an edge of each face."""
    corners, uv = surface.positions[surface.faces], surface.uv[surface.faces] * texels
    length, span = (np.linalg.norm(each - np.roll(each, 1, axis=1), axis=2) for each in (corners, uv))
    size = float(np.linalg.norm(np.ptp(surface.positions, axis=0)))
    stretch = (length / np.maximum(span, 1e-6)).max(axis=1)
    return np.clip(_REACH * stretch, _NEAR * size / texels, _FAR * size / texels)
