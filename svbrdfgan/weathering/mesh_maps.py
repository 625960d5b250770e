"""Mesh maps: visibility, curvature and distances to edges at each texel, by which weathering goes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray
from torch import Tensor

from svbrdfgan.types import Surface
from svbrdfgan.weathering.edges import SharpEdges
from svbrdfgan.weathering.occlusion import ambient_visibility, mean_curvature

_RADIUS = 0.03
"""Curvature is that of a ball of this radius, in lengths of the model."""
EDGE_REACH = 0.03
"""Within which sharp edges matter, in lengths of the model."""
_FALL = 3.0
"""How often the nearness to an edge falls by a factor of e within that reach."""


@dataclass(frozen=True, eq=False)
class MeshMaps:
    """Maps that artists bake of a mesh, as they do position and normal; float64, in which recipes compute.

    Attributes:
        visibility: ambient-occlusion visibility: 1 is unoccluded, 0 is enclosed.
        curvature: mean curvature times a radius of 3 % of the model's length: positive on edges, negative in creases,
            about 1 at a right angle.
        convex, crease, border: distance to the nearest sharp edge of each kind (`EdgeDistances`), in lengths of the
            model, at most `EDGE_REACH`.
    """

    visibility: Float[Tensor, "rows cols"]
    curvature: Float[Tensor, "rows cols"]
    convex: Float[Tensor, "rows cols"]
    crease: Float[Tensor, "rows cols"]
    border: Float[Tensor, "rows cols"]

    def flat(self) -> MeshMaps:
        """The same maps, row by row in one dimension."""
        return MeshMaps(*(values.flatten() for values in vars(self).values()))

    def network_input(self) -> Float[Tensor, "5 rows cols"]:
        """All maps for the generator, in [-1, 1]: curvature beyond 2 is cut off, and edges are 1 and fall off."""
        edges = [2.0 * torch.exp(-_FALL * edge / EDGE_REACH) - 1.0 for edge in (self.convex, self.crease, self.border)]
        return torch.stack([2.0 * self.visibility - 1.0, 0.5 * self.curvature.clamp(-2.0, 2.0), *edges]).float()


class TexelGeometry(Protocol):
    """The fields of a geometry buffer that weathering uses; row 0 is at v = 0.

    Texels without surface have the position and normal of the nearest one with it, and face -1.
    """

    @property
    def position(self) -> Float[ndarray | Tensor, "rows cols 3"]:
        """Metres, in the surface's coordinates."""

    @property
    def normal(self) -> Float[ndarray | Tensor, "rows cols 3"]:
        """Unit, outward."""

    @property
    def face(self) -> Int[ndarray | Tensor, "rows cols"]:
        """Index into the surface's faces; only normal maps need it."""

    @property
    def barycentric(self) -> Float[ndarray | Tensor, "rows cols 3"]:
        """Coordinates of the texel's centre in its face; only normal maps need them."""


def bake_mesh_maps(
    surface: Surface, buffer: TexelGeometry, known: Float[ndarray, "2 texels"] | None = None
) -> MeshMaps:
    """The mesh maps of a surface at the texels of its geometry buffer; takes about a second for 65,000 texels.

    Args:
        known: as for `mesh_maps_at`, row by row.
    """
    rows, cols, _ = buffer.position.shape
    position, normal = (np.asarray(v, np.float64).reshape(-1, 3) for v in (buffer.position, buffer.normal))
    found = mesh_maps_at(surface, position, normal, known)
    return MeshMaps(*(values.view(rows, cols) for values in vars(found).values()))


def mesh_maps_at(
    surface: Surface,
    position: Float[ndarray, "points 3"],
    normal: Float[ndarray, "points 3"],
    known: Float[ndarray, "2 points"] | None = None,
) -> MeshMaps:
    """The mesh maps at points on a surface, in one dimension.

    Args:
        known: visibility and curvature, if they are known, which take most of the time.
    """
    length = length_of(surface)
    near = SharpEdges.of(surface).distances(position, normal, EDGE_REACH * length)
    edges = (edge / length for edge in (near.convex, near.crease, near.border))
    surveyed = survey_maps(surface, position, normal) if known is None else known
    return MeshMaps(*map(torch.from_numpy, (*surveyed, *edges)))


def survey_maps(
    surface: Surface, position: Float[ndarray, "points 3"], normal: Float[ndarray, "points 3"]
) -> tuple[Float[ndarray, " points"], Float[ndarray, " points"]]:
    """Visibility and curvature at points on a surface."""
    visibility = ambient_visibility(surface, position, normal)
    return visibility, mean_curvature(surface, position, normal, _RADIUS * length_of(surface))


def length_of(surface: Surface) -> float:
    """The longer horizontal side of the box around the faces, in metres; a sheet's height, and 1 for a point."""
    extent = np.ptp(surface.positions[np.unique(surface.faces)], axis=0)
    return float(max(extent[0], extent[2]) or extent[1] or 1.0)
