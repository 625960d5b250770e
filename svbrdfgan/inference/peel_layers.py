"""What a generator paints on one peel of an embedded surface."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import normalize

from svbrdfgan.asset.peels import Peel
from svbrdfgan.geometry.tangents import Tangents
from svbrdfgan.geometry.texels import nearest_texels
from svbrdfgan.networks.draw import Draw
from svbrdfgan.networks.generator import Generator
from svbrdfgan.types import Surface
from svbrdfgan.weathering.mesh_maps import bake_mesh_maps


@dataclass(frozen=True, eq=False)
class PeelLayer:
    """What is painted on one peel.

    Attributes:
        values: of a layer, `factor` times as fine as the peel; float16. In place of normals it has what of them lies in
            the tangent plane, in the mesh's axes, so that it can be averaged across tangent frames.
    """

    values: Float[Tensor, "fine_texels channels"]
    factor: int


def paint_peel(
    draw: Draw, generator: Generator, surface: Surface, tangents: Tangents, peel: Peel, factor: int
) -> PeelLayer:
    """The draw's layer on a peel of the surface, `factor` times as fine as the peel."""
    geometry = peel.buffer.network_input()
    if generator.mesh_maps:
        geometry = torch.cat([geometry, bake_mesh_maps(surface, peel.buffer).network_input()])
    with torch.no_grad():
        values = draw(geometry.unsqueeze(0), factor)[0].half()
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
