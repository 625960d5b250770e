"""What a generator paints on one peel of an embedded surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray
from torch import Tensor
from torch.nn.functional import normalize

from svbrdfgan.asset.peels import Peel
from svbrdfgan.asset.points import SurfacePoints
from svbrdfgan.asset.surroundings import Surroundings
from svbrdfgan.geometry.tangents import Tangents
from svbrdfgan.geometry.texels import nearest_texels
from svbrdfgan.networks.draw import Draw
from svbrdfgan.networks.generator import Generator
from svbrdfgan.types import Surface
from svbrdfgan.weathering.mesh_maps import mesh_maps_at


@dataclass(frozen=True, eq=False)
class PeelLayer:
    """What is painted on one peel.

    Attributes:
        values: of a layer, `factor` times as fine as the peel; float16. In place of normals it has what of them lies in
            the tangent plane, in the mesh's axes, so that it can be averaged across tangent frames.
    """

    values: Float[Tensor, "fine_texels channels"]
    factor: int


def mesh_map_inputs(
    surface: Surface, found: Sequence[Peel], surroundings: Surroundings
) -> list[Float[Tensor, "maps rows cols"]]:
    """What a generator reads of the mesh maps of each peel.

    Those of the outermost are surveyed as for training. Beneath, visibility and curvature are interpolated between the
    nodes of the surroundings, since a survey takes several times as long as the network.
    """
    outermost, *beneath = found
    position, normal, _ = _known_points(surface, [outermost])
    maps = mesh_maps_at(surface, position, normal).network_input()
    inputs = [torch.zeros(len(maps), *outermost.known.shape)]
    inputs[0][:, torch.from_numpy(outermost.known)] = maps
    row, col = nearest_texels(outermost.known)
    inputs[0] = inputs[0][:, row, col]
    if beneath:
        position, normal, points = _known_points(surface, beneath)
        known = surroundings.visibility_and_curvature(points)
        maps = mesh_maps_at(surface, position, normal, known).network_input()
        for peel, own in zip(beneath, maps.split([int(peel.known.sum()) for peel in beneath], dim=1), strict=True):
            inputs.append(inputs[0].clone())
            inputs[-1][:, torch.from_numpy(peel.known)] = own
    return inputs


def _known_points(
    surface: Surface, found: Sequence[Peel]
) -> tuple[Float[ndarray, "points 3"], Float[ndarray, "points 3"], SurfacePoints]:
    """Positions and normals of what peels show, and its places on the mesh."""

    def known(name: str) -> ndarray:
        return np.concatenate([getattr(peel.buffer, name).numpy()[peel.known] for peel in found])

    face, position, normal = known("face"), known("position").astype(np.float64), known("normal").astype(np.float64)
    barycentric = np.einsum("pi,pij->pj", known("barycentric"), surface.source_barycentric[face])
    return position, normal, SurfacePoints(surface.source_face[face], barycentric)


def paint_peel(
    draw: Draw,
    generator: Generator,
    surface: Surface,
    tangents: Tangents,
    peel: Peel,
    geometry: Float[Tensor, "inputs rows cols"],
    factor: int,
) -> PeelLayer:
    """The draw's layer on a peel of the surface, `factor` times as fine as the peel.

    Args:
        geometry: what the generator reads of the peel.
    """
    with torch.no_grad():
        values = draw(geometry.unsqueeze(0), factor, torch.from_numpy(peel.known))[0].half()
    if (normal := generator.channels.get("normal")) is not None:
        along, across = _frames(surface, tangents, peel)
        for row in range(len(along)):  # of coarse texels, to bound memory
            fine = values[row * factor : (row + 1) * factor, :, normal].float()
            x, y, _ = normalize(fine, dim=-1).split(1, dim=-1)
            u, v = (axis[row].repeat_interleave(factor, dim=0) for axis in (along, across))
            values[row * factor : (row + 1) * factor, :, normal] = (x * u + y * v).half()
    return PeelLayer(values.reshape(-1, values.shape[-1]), factor)


def _frames(
    surface: Surface, tangents: Tangents, peel: Peel
) -> tuple[Float[Tensor, "rows cols 3"], Float[Tensor, "rows cols 3"]]:
    """Unit tangents and bitangents at a peel's texels; where it has no surface, those of the nearest texel with one."""
    face = peel.buffer.face.numpy()
    nearest = nearest_texels(face >= 0)
    barycentric = peel.buffer.barycentric.numpy()[nearest].reshape(-1, 3)
    axes = tangents.frames(surface.normals[surface.faces], face[nearest].ravel(), barycentric)
    u, v = (torch.from_numpy(axis.reshape(*face.shape, 3)).float() for axis in axes[:2])
    return u, v
