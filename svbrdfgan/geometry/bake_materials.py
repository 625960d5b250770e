"""Materials of files over the UV of the surface that their mesh was embedded in: textures looked up at each texel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray
from torch import Tensor

from svbrdfgan.geometry.normals import unit
from svbrdfgan.geometry.rasterize import Fragments
from svbrdfgan.geometry.split import surface_over
from svbrdfgan.geometry.tangents import Tangents, corner_tangents
from svbrdfgan.geometry.texels import nearest_texels, sample_texture
from svbrdfgan.types import FileMap, Mesh

_UP = np.array([0.0, 0.0, 1.0])


def bake_base_color(mesh: Mesh, fragments: Fragments) -> tuple[Float[Tensor, ...], ...]:
    """The linear base colour of each part: a constant (3,), or its texture resampled to the new UVs, (rows, cols, 3).

    Texels that a part does not cover get the colour of the nearest texel that it covers.
    """
    parts = fragments.surface.parts
    return tuple(
        _looked_up(part.all_maps["base_color"], mesh, _Texels(fragments, index)) for index, part in enumerate(parts)
    )


def bake_file_maps(mesh: Mesh, fragments: Fragments) -> tuple[dict[str, Float[Tensor, ...]], ...]:
    """The `file_maps` of each part: constants (channels,), or textures (rows, cols, channels) over the new UVs.

    Normals are turned from the tangent frames of the mesh's own UVs, those of the normal texture, into the frames of
    the surface's UVs, at unit length.
    """
    parts, baked = fragments.surface.parts, []
    frames = _frames(mesh, fragments)
    for index, part in enumerate(parts):
        texels, normal = _Texels(fragments, index), part.file_maps.get("normal")
        maps = {name: _looked_up(given, mesh, texels) for name, given in part.file_maps.items() if name != "normal"}
        if normal is not None and normal.uv_set in frames:
            maps["normal"] = frames[normal.uv_set].turned(_looked_up(normal, mesh, texels), texels)
        baked.append(maps)
    return tuple(baked)


@dataclass(eq=False)
class _Texels:
    """The points of one part that texels show. Where the part covers no texel, that of the nearest texel it covers."""

    fragments: Fragments
    part: int
    _found: tuple[Int[ndarray, "rows cols"], Float[ndarray, "rows cols 3"]] | None = None

    def points(self) -> tuple[Int[ndarray, "rows cols"], Float[ndarray, "rows cols 3"]] | None:
        """Face of the surface and barycentric coordinates in it; None if the part covers no texel."""
        if self._found is None:
            raster = self.fragments.outermost(self.fragments.surface.face_part == self.part)
            if not raster.mask.any():
                return None
            nearest = nearest_texels(raster.mask)
            self._found = raster.face[nearest], raster.barycentric[nearest]
        return self._found


def _looked_up(given: FileMap, mesh: Mesh, texels: _Texels) -> Float[Tensor, ...]:
    """The map at the part's texels, or as a constant: its mean, if the part covers none."""
    value = torch.tensor(given.factor, dtype=torch.float32)
    own = mesh.uv_set(given.uv_set)
    if given.texture is not None and own is not None:
        texture = torch.from_numpy(given.texture).float()
        points, surface = texels.points(), texels.fragments.surface
        if points is None:
            value = value * texture.mean(dim=(0, 1))
        else:
            face, barycentric = points
            corners = np.einsum("fij,fjk->fik", surface.source_barycentric, own[surface.source_face])
            uv = np.einsum("rcj,rcjk->rck", barycentric, corners[face])
            sampled = sample_texture(texture, torch.from_numpy(uv).reshape(-1, 2), repeat=(True, True))
            value = value * sampled.float().reshape(*face.shape, -1)
    return value if given.cutoff is None else (value >= given.cutoff).float()


def _frames(mesh: Mesh, fragments: Fragments) -> dict[int, _Frames]:
    """The frames of each of the mesh's UV sets that has a normal texture."""
    maps = [part.file_maps["normal"] for part in fragments.surface.parts if "normal" in part.file_maps]
    used = {given.uv_set: mesh.uv_set(given.uv_set) for given in maps}
    new = corner_tangents(fragments.surface) if used else None
    return {
        number: _Frames(corner_tangents(surface_over(mesh, uv)), new)
        for number, uv in used.items()
        if uv is not None and new is not None
    }


@dataclass(frozen=True, eq=False)
class _Frames:
    """Tangent frames of a set of a mesh's own UVs and of the surface's UVs."""

    own: Tangents
    new: Tangents

    def turned(self, normal: Float[Tensor, ...], texels: _Texels) -> Float[Tensor, ...]:
        """Unit normals in the surface's frames, from normals of any length in the mesh's own.

        Both frames share the shading normal N. So this turns x and y about it, and mirrors them if one is left-handed.
        """
        points, surface = texels.points(), texels.fragments.surface
        if points is None:
            return torch.from_numpy(_UP).float()
        face, barycentric = points
        upward = unit(np.einsum("rcj,rcjk->rck", barycentric, surface.normals[surface.faces[face]]))
        source = np.einsum("rcj,rcjk->rck", barycentric, surface.source_barycentric[face])
        source_face = surface.source_face[face]
        tangent = _perpendicular(np.einsum("rcj,rcjk->rck", barycentric, self.new.direction[face]), upward)
        its = _perpendicular(np.einsum("rcj,rcjk->rck", source, self.own.direction[source_face]), upward)
        hand, its_hand = self.new.handedness[face], self.own.handedness[source_face]
        along = (its * tangent).sum(axis=-1)
        across = hand * (its * np.cross(upward, tangent)).sum(axis=-1)
        x, y, z = np.moveaxis(normal.double().numpy(), -1, 0)
        y = y * hand * its_hand
        turned = np.stack([x * along - y * across, x * across + y * along, z], axis=-1)
        return torch.from_numpy(unit(turned, _UP)).float()


def _perpendicular(
    vectors: Float[ndarray, "rows cols 3"], normals: Float[ndarray, "rows cols 3"]
) -> Float[ndarray, "rows cols 3"]:
    """The components of the vectors perpendicular to the normals, scaled to unit length."""
    return unit(vectors - (vectors * normals).sum(axis=-1, keepdims=True) * normals)
