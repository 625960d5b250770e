"""What a weathered material showed before, at the texels of its new textures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import torch
from jaxtyping import Float, UInt8
from numpy import ndarray
from torch import Tensor

from svbrdfgan.asset.painted_texture import Canvas
from svbrdfgan.asset.texture_bands import Band
from svbrdfgan.geometry.texels import sample_texture
from svbrdfgan.io.gltf.document import Json
from svbrdfgan.io.gltf.materials import DocumentPictures
from svbrdfgan.io.uv_sets import UVSet

if TYPE_CHECKING:
    from PIL.Image import Image

Bytes = UInt8[ndarray, "rows cols channels"]
Lookup = Callable[[Json], Float[ndarray, "faces 3 2"] | None]
"""The UVs at which a `textureInfo` is looked up, at the corners of a canvas's faces; None if there are none."""


@dataclass(frozen=True, eq=False)
class Sheet:
    """The texels of the textures that replace a material's own.

    Attributes:
        canvas: the faces that they cover.
        rows, cols: size.
        own: the UVs that the sheet shares with the material's own textures; None if it lies over a new set.
        lookup: of the material's own textures.
        pictures: of the file as it was.
    """

    canvas: Canvas
    rows: int
    cols: int
    own: UVSet | None
    lookup: Lookup
    pictures: DocumentPictures

    def source(self, info: Json | None) -> Source:
        """Where a texture of the material is found at the sheet's texels; white if there is none that can be read."""
        picture = self.pictures.of(info)
        if info is None or picture is None:
            return White()
        if UVSet.of(info) == self.own:
            return InPlace(_resized(picture, self.rows, self.cols))
        uv = self.lookup(info)
        # without UVs viewers take one corner of the texture
        return Elsewhere(self.canvas, _texture(picture), np.zeros_like(self.canvas.uv) if uv is None else uv)


class White:
    """A texture that is 1 everywhere: none at all."""

    channels = 3
    needs_points = False

    def rows(self, band: Band, cols: int) -> Bytes:
        return np.full((len(band.rows), cols, 3), 255, np.uint8)


@dataclass(frozen=True, eq=False)
class InPlace:
    """A texture over the sheet's own UVs, at its size: bytes stay as they are."""

    texture: Bytes
    needs_points = False

    @property
    def channels(self) -> int:
        return self.texture.shape[2]

    def rows(self, band: Band, cols: int) -> Bytes:
        return self.texture[band.rows.start : band.rows.stop]


@dataclass(frozen=True, eq=False)
class Elsewhere:
    """A texture over other UVs, looked up at each texel that shows a face; 0 at the others."""

    canvas: Canvas
    texture: Float[Tensor, "rows cols channels"]
    uv: Float[ndarray, "faces 3 2"]
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
        at = torch.from_numpy(band.points.interpolate(self._corners)).float()
        found = sample_texture(self.texture, at, repeat=(True, True))
        made[band.covered] = found.round().clamp(0, 255).byte().numpy()
        return made


Source = White | InPlace | Elsewhere


def _texture(picture: Image) -> Float[Tensor, "rows cols channels"]:
    return torch.from_numpy(np.array(_eight_bit(picture))[::-1].astype(np.float32))


def _resized(picture: Image, rows: int, cols: int) -> Bytes:
    """The picture at that size, row 0 at v = 0; averaged where it becomes smaller."""
    from PIL import Image as PillowImage

    whole = _eight_bit(picture)
    if whole.size != (cols, rows):
        smaller = whole.size[0] > cols or whole.size[1] > rows
        filter_ = PillowImage.Resampling.BOX if smaller else PillowImage.Resampling.BILINEAR
        whole = whole.resize((cols, rows), filter_)
    return np.asarray(whole)[::-1]


def _eight_bit(picture: Image) -> Image:
    """The picture with 8 bits a channel, RGB or RGBA."""
    from PIL import Image as PillowImage

    if picture.mode.startswith("I"):  # 16-bit grey, which Pillow's convert would clip
        grey = np.clip(np.asarray(picture).astype(np.float32) / 257.0, 0, 255).astype(np.uint8)
        picture = PillowImage.fromarray(grey)
    alpha = "A" in picture.getbands() or "transparency" in picture.info
    return picture.convert("RGBA" if alpha else "RGB")
