"""What a weathered material showed before, at the texels of its new textures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float, UInt8
from numpy import ndarray
from torch import Tensor

from svbrdfgan.asset.painted_texture import Canvas
from svbrdfgan.asset.tangent_turns import Turns, turned
from svbrdfgan.asset.texture_bands import Band
from svbrdfgan.asset.weathered_maps import tinted
from svbrdfgan.geometry.texels import sample_texture
from svbrdfgan.io.eight_bit import flipped_bytes, resized_bytes
from svbrdfgan.io.gltf.document import Json
from svbrdfgan.io.gltf.materials import DocumentPictures
from svbrdfgan.io.gltf.samplers import Sampler
from svbrdfgan.io.uv_sets import UVSet

Bytes = UInt8[ndarray, "rows cols channels"]
Lookup = Callable[[UVSet], Float[ndarray, "faces 3 2"] | None]
"""The UVs of a set at the corners of a canvas's faces; None if there are none."""


@dataclass(frozen=True, eq=False)
class Sheet:
    """The texels of the textures that replace a material's own.

    Attributes:
        canvas: the faces that they cover.
        rows, cols: size.
        own: the UVs that the sheet shares with the material's own textures; None if it lies over a new set.
        lookup: of the material's own textures.
        pictures: of the file as it was.
        colors: linear RGBA of the vertices, at the corners of all faces of the mesh; None if there are none.
        turns: of the file's normals; None if they stay as they are.
    """

    canvas: Canvas
    rows: int
    cols: int
    own: UVSet | None
    lookup: Lookup
    pictures: DocumentPictures
    colors: Float[ndarray, "mesh_faces 3 4"] | None = None
    turns: Turns | None = None

    def color_source(self, info: Json | None) -> Source:
        """Where a colour of the material is found at the sheet's texels, times that of vertices; white if none."""
        source = self.source(info)
        return source if self.colors is None else Tinted(source, self.colors)

    def normal_source(self, info: Json | None) -> Source:
        """Where a normal of the material is found at the sheet's texels, in the sheet's tangent frames."""
        source = self.source(info)
        return source if self.turns is None else Turned(source, self.turns)

    def source(self, info: Json | None) -> Plain:
        """Where other textures of the material are found at the sheet's texels; white if there is none."""
        picture = self.pictures.of(info)
        if info is None or picture is None:
            return White()
        if UVSet.of(info) == self.own:
            return InPlace(resized_bytes(picture, self.rows, self.cols))
        uv = self.lookup(UVSet.of(info))
        # without UVs viewers take one corner of the texture
        uv = np.zeros_like(self.canvas.uv) if uv is None else uv
        texture = torch.from_numpy(flipped_bytes(picture).astype(np.float32))
        return Elsewhere(self.canvas, texture, uv, Sampler.of(self.pictures.document, info))


class White:
    """A texture that is 1 everywhere: none at all."""

    channels = 3
    needs_points = False

    def rows(self, band: Band, cols: int) -> Bytes:
        return np.full((len(band.rows), cols, 4), 255, np.uint8)


@dataclass(frozen=True, eq=False)
class InPlace:
    """A texture over the sheet's own UVs, at its size: bytes stay as they are."""

    texture: Bytes
    needs_points = False

    @property
    def channels(self) -> int:
        return self.texture.shape[2]

    def rows(self, band: Band, cols: int) -> Bytes:
        return _rgba(self.texture[band.rows.start : band.rows.stop])


@dataclass(frozen=True, eq=False)
class Elsewhere:
    """A texture over other UVs, looked up at each texel that shows a face; 0 at the others."""

    canvas: Canvas
    texture: Float[Tensor, "rows cols channels"]
    uv: Float[ndarray, "faces 3 2"]
    sampler: Sampler
    needs_points = True

    @property
    def channels(self) -> int:
        return self.texture.shape[2]

    @cached_property
    def _corners(self) -> Float[ndarray, "mesh_faces 3 2"]:
        corners = np.zeros((len(self.canvas.mesh.faces), 3, 2))
        corners[self.canvas.faces] = self.uv
        return corners

    def rows(self, band: Band, cols: int) -> Bytes:
        made = np.zeros((len(band.rows), cols, self.channels), np.uint8)
        at = self.sampler.inside(band.points.interpolate(self._corners), *self.texture.shape[:2])
        found = sample_texture(self.texture, torch.from_numpy(at).float(), self.sampler.repeat)
        made[band.covered] = found.round().clamp(0, 255).byte().numpy()
        return _rgba(made)


@dataclass(frozen=True, eq=False)
class Tinted:
    """A texture times the vertices' colours, at each texel that shows a face."""

    source: Plain
    colors: Float[ndarray, "mesh_faces 3 4"]
    needs_points = True

    @property
    def channels(self) -> int:
        return 4 if (self.colors[..., 3] != 1.0).any() else self.source.channels

    def rows(self, band: Band, cols: int) -> Bytes:
        color = np.ones((len(band.rows), cols, 4), np.float32)
        color[band.covered] = band.points.interpolate(self.colors)
        return tinted(self.source.rows(band, cols), color)


@dataclass(frozen=True, eq=False)
class Turned:
    """A normal map in other tangent frames, at each texel that shows a face."""

    source: Plain
    turns: Turns
    needs_points = True

    @property
    def channels(self) -> int:
        return self.source.channels

    def rows(self, band: Band, cols: int) -> Bytes:
        made = self.source.rows(band, cols).copy()
        normals = made[band.covered, :3] / 127.5 - 1.0
        stored = 127.5 * (turned(normals, band.points.interpolate(self.turns)) + 1.0)
        made[band.covered, :3] = np.round(np.clip(stored, 0.0, 255.0)).astype(np.uint8)
        return made


Plain = White | InPlace | Elsewhere
Source = Plain | Tinted | Turned


def _rgba(texture: Bytes) -> UInt8[ndarray, "rows cols 4"]:
    return texture if texture.shape[2] == 4 else np.pad(texture, ((0, 0), (0, 0), (0, 1)), constant_values=255)
