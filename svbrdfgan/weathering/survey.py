"""Surveys a surface: finds the site that weathering recipes paint."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray
from torch import Tensor

from svbrdfgan.geometry.tangents import corner_tangents
from svbrdfgan.geometry.texels import nearest_texels
from svbrdfgan.types import Surface
from svbrdfgan.weathering.edges import EdgeDistances
from svbrdfgan.weathering.mesh_maps import MeshMaps, TexelGeometry, length_of, mesh_maps_at
from svbrdfgan.weathering.occlusion import scatter
from svbrdfgan.weathering.site import Site

_CAR = 4.5  # metres
_LENGTHS = (2.0, 20.0)  # metres, of vehicles
_USUAL_AXLES = (-0.3, 0.3)  # z in lengths of the model, from its centre


def find_site(surface: Surface, buffer: TexelGeometry, maps: MeshMaps | None = None, *, tangents: bool = False) -> Site:
    """The geometry that recipes use, at each texel of the buffer, row by row.

    Args:
        maps: the buffer's mesh maps, which else are computed.
        tangents: whether the site has them, for normal maps: those of `texel_tangents`.
    """
    position, normal = (np.asarray(values, np.float64) for values in (buffer.position, buffer.normal))
    steps = np.linalg.norm(np.diff(position, axis=1), axis=2)
    texel = float(np.median(steps[steps > 0.0])) if steps.any() else 0.0
    found = survey(surface, position.reshape(-1, 3), normal.reshape(-1, 3), texel, maps)
    return replace(found, tangents=texel_tangents(surface, buffer)) if tangents else found


def texel_tangents(surface: Surface, buffer: TexelGeometry) -> Float[Tensor, "texels 2 3"]:
    """Unit tangents and bitangents at the texels, both reversed where the buffer's normal is the surface's reversed.

    There the surface is seen from behind, where renderers reverse the whole tilted normal.
    """
    face, weights = (np.asarray(values) for values in (buffer.face, buffer.barycentric))
    nearest = nearest_texels(face >= 0)
    normals = surface.normals[surface.faces]
    tangent, bitangent, normal = corner_tangents(surface).frames(
        normals, face[nearest].ravel(), weights[nearest].reshape(-1, 3)
    )
    outward = np.asarray(buffer.normal, np.float64).reshape(-1, 3)
    side = np.where((outward * normal).sum(axis=1, keepdims=True) < 0.0, -1.0, 1.0)
    return torch.from_numpy(np.stack([side * tangent, side * bitangent], axis=1))


def survey(
    surface: Surface,
    position: Float[ndarray, "texels 3"],
    normal: Float[ndarray, "texels 3"],
    texel: float = 0.0,
    maps: MeshMaps | None = None,
) -> Site:
    """The site at points on a surface. Without `maps` it takes about a second for 65,000 points.

    Args:
        position, texel: in metres.
        maps: the mesh maps at these points, if they are known.
    """
    found, grounds = (maps or mesh_maps_at(surface, position, normal)).flat(), Grounds.of(surface)
    edges = EdgeDistances(*(grounds.length * edge.numpy() for edge in (found.convex, found.crease, found.border)))
    visibility, curvature = found.visibility.numpy(), found.curvature.numpy()
    return grounds.site(position, normal, visibility, curvature, texel, edges=edges)


@dataclass(frozen=True, eq=False)
class Grounds:
    """What all sites on one model share.

    Attributes:
        origin: the centre of the bounding box's bottom face, metres.
        length: of the model, in the surface's units.
        height: from the ground to the roof, in the surface's units.
        axles: z of the wheels, in lengths of the model from the origin.
        metres: length of the model in metres.
    """

    origin: Float[ndarray, " axes"]
    length: float
    height: float
    axles: tuple[float, ...]
    metres: float

    @classmethod
    def of(cls, surface: Surface, metres: float | None = None) -> Grounds:
        """What sites on a surface share; by default its `metres` are those of `likely_length`."""
        used = surface.positions[np.unique(surface.faces)]
        low, high = used.min(axis=0), used.max(axis=0)
        length = length_of(surface)
        height = max(float(high[1] - low[1]), 1e-6 * length)
        origin = np.array([(low[0] + high[0]) / 2.0, low[1], (low[2] + high[2]) / 2.0])
        cloud = scatter(surface, 0.01 * length)[0]
        axles = find_axles((cloud - origin) / [length, height, length])
        return cls(origin, length, height, axles, metres or likely_length(length))

    def site(
        self,
        position: Float[ndarray, "points 3"],
        normal: Float[ndarray, "points 3"],
        visibility: Float[ndarray, " points"],
        curvature: Float[ndarray, " points"],
        texel: float,
        *,
        edges: EdgeDistances | None = None,
        substance: Int[ndarray, " points"] | None = None,
    ) -> Site:
        """The site at points; `position`, `texel` and `edges` in the surface's units.

        Args:
            edges: by default there are none.
            substance: by default everything is painted sheet.
        """
        centred = (position - self.origin) / self.length
        none, scale = np.full(len(normal), np.inf), self.metres / self.length
        convex, crease, border = (none,) * 3 if edges is None else (edges.convex, edges.crease, edges.border)
        painted = np.zeros(len(normal), np.uint8) if substance is None else substance
        return Site(
            position=torch.from_numpy(centred),
            height=torch.from_numpy(np.clip(centred[:, 1] * self.length / self.height, 0.0, 1.0)),
            normal=torch.from_numpy(np.ascontiguousarray(normal)),
            visibility=torch.from_numpy(np.ascontiguousarray(visibility)),
            curvature=torch.from_numpy(np.ascontiguousarray(curvature)),
            convex=torch.from_numpy(convex * scale),
            crease=torch.from_numpy(crease * scale),
            border=torch.from_numpy(border * scale),
            substance=torch.from_numpy(painted),
            axles=self.axles,
            texel=texel / self.length,
            length=self.metres,
            tall=self.height * scale,
        )


def likely_length(length: float) -> float:
    """Metres of a model that is `length` units long: those are metres if that makes a vehicle of it, else it is a car.

    Files come in metres, centimetres, inches or nothing at all.
    """
    return length if _LENGTHS[0] <= length <= _LENGTHS[1] else _CAR


def find_axles(cloud: Float[ndarray, "points 3"]) -> tuple[float, ...]:
    """z of the axles: the centres of the patches that touch the ground.

    The cloud's x and z are in lengths of the model, its y in heights. If there are fewer than two patches, or one is
    longer than a fifth of the model, they are not wheels and the default axles are returned.
    """
    contact = np.sort(cloud[cloud[:, 1] < 0.04, 2])
    patches = np.split(contact, np.flatnonzero(np.diff(contact) > 0.04) + 1)
    wheels = [patch for patch in patches if len(patch) > 3]
    if len(wheels) < 2 or max(np.ptp(patch) for patch in wheels) > 0.2:
        return _USUAL_AXLES
    return tuple(float(patch.min() + patch.max()) / 2.0 for patch in wheels)
