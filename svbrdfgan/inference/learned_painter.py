"""Looks up what a generator painted on the peels of a mesh's embedding, at any point of the mesh."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray

from svbrdfgan.asset.painters import Paint
from svbrdfgan.asset.points import SurfacePoints
from svbrdfgan.geometry.normals import unit
from svbrdfgan.geometry.texels import bilinear_taps
from svbrdfgan.inference.embedded_peels import EmbeddedPeels
from svbrdfgan.inference.peel_layers import PeelLayer
from svbrdfgan.types import Mesh

_SEAM = 3.0  # texels
_CLEARLY = 0.15  # of the reach: how much nearer than any other peel's a tap must be to count in full
_NOWHERE = 1e9


@dataclass(frozen=True, eq=False)
class LearnedPainter:
    """Looks points up in the layer of the peel that shows them.

    A point is looked up at its own UV, among the texels around that show its surface. Where few do, at the borders of
    what covers it, at cuts, and in what the embedding hides deeper than the peels reach, the nearest texels in space
    take over.

    Attributes:
        mesh: the model.
        embedded: its peels.
        layers: on the peels.
        maps: what is painted besides base colour; those that the layers lack are 0.
        shares: of each face of the mesh: what alpha is multiplied by.
    """

    mesh: Mesh
    embedded: EmbeddedPeels
    layers: Sequence[PeelLayer]
    channels: Mapping[str, slice]
    maps: Collection[str]
    shares: Float[ndarray, " mesh_faces"]

    def __call__(self, points: SurfacePoints, texel: float) -> Paint:
        at = self.embedded.subfaces.find(points)
        values = self._values(points.positions(self.mesh).astype(np.float32), at)
        found = {name: values[:, channels] for name, channels in self.channels.items()}
        nothing = np.zeros((len(points), 1))
        return Paint(
            found["base_color"],
            found["alpha"][:, 0] * self.shares[points.face],
            found.get("roughness", nothing)[:, 0],
            found.get("metallic", nothing)[:, 0],
            nothing[:, 0],
            self._normals(found["normal"], at) if "normal" in found else None,
        )

    def _values(self, position: Float[ndarray, "points 3"], at: SurfacePoints) -> Float[ndarray, "points channels"]:
        """Continuous but where the layer is not: what enters or leaves a mean does so with no weight."""
        uv = at.interpolate(self.embedded.surface.uv[self.embedded.surface.faces])
        rows, cols = self.embedded.shape
        index, weight = (
            tensor.numpy() for tensor in bilinear_taps(torch.from_numpy(uv), rows, cols, self.embedded.surface.repeat)
        )
        peel, shows = self._shown(index, position, self.embedded.reach[at.face])
        share = np.zeros((len(uv), len(self.layers)))
        np.add.at(share, (np.arange(len(uv))[:, None], peel), weight * shows)
        main = share.argmax(axis=1)
        agreed = share[np.arange(len(uv)), main] * self._inside(uv)
        values = np.zeros((len(uv), self.layers[0].values.shape[1]), np.float32)
        whole = agreed > 1.0 - 1e-6
        values[whole] = self._sampled(main[whole], uv[whole])
        mixed = np.flatnonzero(~whole & (agreed > 0.5))
        for tap in range(index.shape[1]):
            own = mixed[peel[mixed, tap] == main[mixed]]
            part = (weight * shows)[own, tap, None] / share[own, main[own], None]
            values[own] += part * self._sampled(main[own], self._within(index[own, tap], main[own], uv[own]))
        lost = np.flatnonzero(~whole)
        trust = np.clip(2.0 * agreed[lost] - 1.0, 0.0, 1.0)[:, None]
        values[lost] = trust * values[lost] + (1.0 - trust) * self._near(position[lost], at, lost)
        return values

    def _inside(self, uv: Float[ndarray, "points 2"]) -> Float[ndarray, " points"]:
        """1 but for a few texels at those borders of the UV square where the layer ends, and the surface may go on."""
        depth = np.minimum(uv, 1.0 - uv) * self.embedded.shape[::-1] / _SEAM
        depth[:, self.embedded.surface.repeat] = 1.0
        return np.clip(0.5 + 0.5 * depth.min(axis=1), 0.5, 1.0)

    def _shown(
        self, index: Int[ndarray, "points taps"], position: Float[ndarray, "points 3"], reach: Float[ndarray, " points"]
    ) -> tuple[Int[ndarray, "points taps"], Float[ndarray, "points taps"]]:
        """The peel of each tap that is nearest to the point, and how surely it shows the point's surface."""
        peel, shows = np.zeros(index.shape, np.int64), np.zeros(index.shape)
        for tap in range(index.shape[1]):
            distance = np.linalg.norm(self.embedded.taps[:, index[:, tap]] - position, axis=2)
            distance = np.where(np.isfinite(distance), distance, _NOWHERE)
            peel[:, tap] = distance.argmin(axis=0)
            best, *others = np.partition(distance, min(1, len(distance) - 1), axis=0)[:2] / reach
            shows[:, tap] = np.clip(2.0 - best, 0.0, 1.0)
            for second in others:
                shows[:, tap] *= np.clip((second - best) / _CLEARLY, 0.0, 1.0)
        return peel, shows

    def _within(
        self, tap: Int[ndarray, " points"], peel: Int[ndarray, " points"], uv: Float[ndarray, "points 2"]
    ) -> Float[ndarray, "points 2"]:
        """The UVs moved to between the centres of the finer texels in the texel of a tap: no other is looked up."""
        size = np.array(self.embedded.shape[::-1])
        centre = np.stack([tap % size[0], tap // size[0]], axis=1) + 0.5
        inner = 0.5 - 0.5 / np.array([layer.factor for layer in self.layers])[peel, None]
        return (centre + np.clip(uv * size - centre, -inner, inner)) / size

    def _sampled(
        self, peel: Int[ndarray, " points"], uv: Float[ndarray, "points 2"]
    ) -> Float[ndarray, "points channels"]:
        """The layers of peels at UVs."""
        values = np.zeros((len(uv), self.layers[0].values.shape[1]), np.float32)
        for number in np.unique(peel):
            mine, layer = np.flatnonzero(peel == number), self.layers[number]
            rows, cols = (side * layer.factor for side in self.embedded.shape)
            index, weight = bilinear_taps(torch.from_numpy(uv[mine]), rows, cols, self.embedded.surface.repeat)
            values[mine] = (layer.values[index].float() * weight[..., None]).sum(dim=1).numpy()
        return values

    def _near(
        self, position: Float[ndarray, "lost 3"], at: SurfacePoints, lost: Int[ndarray, " lost"]
    ) -> Float[ndarray, "lost channels"]:
        """The mean of the nearest texels in space."""
        if not len(lost):
            return np.zeros((0, self.layers[0].values.shape[1]), np.float32)
        faces = self.embedded.surface.faces[at.face[lost]]
        normal = unit(np.einsum("pj,pjk->pk", at.barycentric[lost], self.embedded.surface.normals[faces]))
        weight, tap = self.embedded.nearest(position, normal * self.embedded.side[at.face[lost], None])
        return np.einsum("pn,pnc->pc", weight.astype(np.float32), self._centres[tap])

    @cached_property
    def _centres(self) -> Float[ndarray, "taps channels"]:
        """The layers at the centres of all peels' texels: of an even number of finer texels, their middle four."""
        rows, cols = self.embedded.shape
        found = []
        for layer in self.layers:
            fine = layer.values.reshape(rows, layer.factor, cols, layer.factor, -1)
            middle = slice((layer.factor - 1) // 2, layer.factor // 2 + 1)
            found.append(fine[:, middle][:, :, :, middle].float().mean(dim=(1, 3)).flatten(0, 1))
        return torch.cat(found).numpy()

    def _normals(self, leaning: Float[ndarray, "points 3"], at: SurfacePoints) -> Float[ndarray, "points 3"]:
        """Unit normals that lean so, on the side of the winding's front."""
        upward = unit(at.interpolate(self.embedded.surface.normals[self.embedded.surface.faces]))
        flat = leaning - (leaning * upward).sum(axis=1, keepdims=True) * upward
        rise = np.sqrt(np.clip(1.0 - (flat**2).sum(axis=1, keepdims=True), 1e-4, 1.0))
        return unit(flat + rise * upward)
