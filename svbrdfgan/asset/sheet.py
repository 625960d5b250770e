"""The pictures of a weathered material: what it showed, over the texels of its new textures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch
from jaxtyping import Float, UInt8
from numpy import ndarray

from svbrdfgan.asset.painted_texture import Canvas, fill
from svbrdfgan.asset.texture_bands import bands
from svbrdfgan.geometry.texels import sample_texture

if TYPE_CHECKING:
    from PIL.Image import Image


@dataclass(frozen=True, eq=False)
class Sheet:
    """The texels of the textures that replace a material's own.

    Attributes:
        canvas: the faces that they cover.
        rows, cols: size.
    """

    canvas: Canvas
    rows: int
    cols: int

    def resized(self, picture: Image) -> UInt8[ndarray, "rows cols channels"]:
        """A picture over the same UVs at the sheet's size, row 0 at v = 0; bytes as they are if it has that size."""
        from PIL import Image as PillowImage

        whole = _eight_bit(picture)
        if whole.size != (self.cols, self.rows):
            smaller = whole.size[0] > self.cols or whole.size[1] > self.rows
            whole = whole.resize(
                (self.cols, self.rows), PillowImage.Resampling.BOX if smaller else PillowImage.Resampling.BILINEAR
            )
        return np.asarray(whole).reshape(self.rows, self.cols, -1)[::-1]

    def resampled(self, picture: Image, uv: Float[ndarray, "faces 3 2"]) -> UInt8[ndarray, "rows cols channels"]:
        """A picture over other UVs, given at the corners of the canvas's faces, looked up at each texel."""
        texture = torch.from_numpy(np.array(_eight_bit(picture))[::-1].astype(np.float32))
        texture = texture.reshape(*texture.shape[:2], -1)
        made = np.zeros((self.rows, self.cols, texture.shape[2]), np.uint8)
        known = np.zeros((self.rows, self.cols), bool)
        corners = np.zeros((len(self.canvas.mesh.faces), 3, 2))
        corners[self.canvas.faces] = uv
        for band in bands(self.canvas.uv, self.canvas.faces, self.rows, self.cols):
            own = slice(band.first, band.first + len(band.covered))
            at = torch.from_numpy(band.points.interpolate(corners))
            found = sample_texture(texture, at, repeat=(True, True))
            made[own][band.covered] = found.round().clamp(0, 255).byte().numpy()
            known[own] = band.covered
        fill(made, known)
        return made

    def interpolated(self, values: Float[ndarray, "mesh_faces 3 k"]) -> Float[ndarray, "rows cols k"]:
        """Values that are given at the corners of all faces of the mesh, at each texel; float32."""
        made = np.zeros((self.rows, self.cols, values.shape[2]), np.float32)
        known = np.zeros((self.rows, self.cols), bool)
        for band in bands(self.canvas.uv, self.canvas.faces, self.rows, self.cols):
            own = slice(band.first, band.first + len(band.covered))
            made[own][band.covered], known[own] = band.points.interpolate(values), band.covered
        fill(made, known)
        return made


def _eight_bit(picture: Image) -> Image:
    """The picture with 8 bits a channel, RGB or RGBA."""
    from PIL import Image as PillowImage

    if picture.mode.startswith("I"):  # 16-bit grey, which Pillow's convert would clip
        grey = np.clip(np.asarray(picture).astype(np.float32) / 257.0, 0, 255).astype(np.uint8)
        picture = PillowImage.fromarray(grey)
    alpha = "A" in picture.getbands() or "transparency" in picture.info
    return picture.convert("RGBA" if alpha else "RGB")
