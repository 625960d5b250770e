"""Peels of an embedded surface: the outermost surface at each texel, as training sees it, and what lies beneath."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float
from numpy import ndarray

from svbrdfgan.geometry.bake import GeometryBuffer, bake, exposed_faces
from svbrdfgan.geometry.normals import unit
from svbrdfgan.geometry.rasterize import Fragments

MOST = 8
"""Peels at most: what lies deeper is hardly seen."""
_FEW = 0.05
"""A peel that shows less, of the texels of the outermost, is not worth a pass of the network, and ends them."""
_SAME = 2e-3  # of the extent of elevations: fragments this close are one surface


@dataclass(frozen=True, eq=False)
class Peel:
    """A geometry buffer, and the texels where it shows its own depth; elsewhere it is that of the outermost peel."""

    buffer: GeometryBuffer
    known: Bool[ndarray, "rows cols"]

    @property
    def positions(self) -> Float[ndarray, "rows cols 3"]:
        """Metres; NaN where the peel shows nothing of its own."""
        return np.where(self.known[..., None], self.buffer.position.numpy(), np.nan).astype(np.float32)


def peels(
    fragments: Fragments, wanted: Bool[ndarray, " mesh_faces"], behind: Bool[ndarray, " mesh_faces"]
) -> Iterator[Peel]:
    """The outermost surface, and then the wanted faces beneath, peel by peel, until there are few or `MOST`.

    Args:
        wanted: faces of the mesh that are to be reached.
        behind: faces of the mesh that are seen from the side that their winding calls the back.
    """
    surface, outer = fragments.surface, bake(fragments)
    raster = fragments.outermost(exposed_faces(surface))
    yield Peel(outer, outer.mask.numpy())
    rest = wanted[surface.source_face[fragments.face]]
    same = _SAME * float(np.ptp(surface.elevation))
    side = np.where(behind[surface.source_face], -1.0, 1.0)
    for _ in range(MOST - 1):
        rest = rest & (np.abs(fragments.elevation - raster.elevation.ravel()[fragments.texel]) > same)
        if not rest.any():
            return
        chosen = replace(
            fragments,
            face=fragments.face[rest],
            texel=fragments.texel[rest],
            elevation=fragments.elevation[rest],
        )
        raster = chosen.outermost()
        known = raster.mask
        if known.sum() < _FEW * outer.mask.sum():
            return
        position = raster.interpolate(surface.faces, surface.positions)
        normal = unit(raster.interpolate(surface.faces, surface.normals)) * side[raster.face][..., None]
        yield Peel(
            replace(
                outer,
                position=_over(outer.position, position, known),
                normal=_over(outer.normal, normal, known),
                face=torch.where(torch.from_numpy(known), torch.from_numpy(raster.face), outer.face),
                barycentric=_over(outer.barycentric, raster.barycentric, known),
            ),
            known,
        )


def _over(under: torch.Tensor, values: ndarray, known: Bool[ndarray, "rows cols"]) -> torch.Tensor:
    return torch.where(torch.from_numpy(known)[..., None], torch.from_numpy(values).to(under.dtype), under)
