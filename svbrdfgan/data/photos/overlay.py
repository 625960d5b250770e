"""Draws the outlines of a mesh, as a given camera sees it, over the picture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int
from numpy import ndarray
from torch import Tensor

from svbrdfgan.data.photos.calibrated_camera import CalibratedCamera
from svbrdfgan.geometry.rasterize import Raster, rasterize
from svbrdfgan.io.image import picture
from svbrdfgan.types import Camera, Mesh, Surface

if TYPE_CHECKING:
    from PIL.Image import Image

NO_PART = -1
_SIDE = 640
_YELLOW = (255, 220, 0)
_ORANGE = (255, 120, 0)
_CYAN = (0, 220, 255)
_CELL = (240, 180)
"""Width and height of a thumbnail, pixels."""
_CAPTION = 16
"""Height of a caption, pixels."""
_COLUMNS = 5
_WHITE = (255, 255, 255)
_GREY = (40, 40, 40)


def visible_parts(mesh: Mesh, camera: Camera, width: int, height: int) -> Int[ndarray, "height width"]:
    """The part that the centre of each pixel shows, `NO_PART` outside the mesh; row 0 on top.

    Raises:
        ConfigError: a part of the mesh is not in front of the camera.
    """
    raster = _raster(mesh, camera, width, height)
    return np.where(raster.mask, mesh.face_part[raster.face], NO_PART)[::-1]


def visible_depth(mesh: Mesh, camera: Camera, width: int, height: int) -> Float[ndarray, "height width"]:
    """How far along the camera's axis the surface at the centre of each pixel is; infinite outside the mesh.

    Raises:
        ConfigError: a part of the mesh is not in front of the camera.
    """
    raster = _raster(mesh, camera, width, height)
    return np.where(raster.mask, 1 / np.where(raster.mask, raster.elevation, 1.0), np.inf)[::-1]


def _raster(mesh: Mesh, camera: Camera, width: int, height: int) -> Raster:
    """The nearest face at the centre of each pixel, whose elevation is one over its depth; row 0 at the bottom."""
    at, depth = CalibratedCamera.of(camera, (width, height)).film_coordinates(mesh.positions)
    count = len(mesh.faces)
    seen = Surface(
        positions=mesh.positions,
        normals=np.zeros_like(mesh.positions),
        uv=at / 2 + 0.5,
        faces=mesh.faces,
        face_part=mesh.face_part,
        parts=mesh.parts,
        elevation=1 / depth,  # the nearest face wins; and 1 / depth is linear over a perspective picture
        source_face=np.arange(count),
        source_barycentric=np.broadcast_to(np.eye(3), (count, 3, 3)),
    )
    return rasterize(seen, height, width)


def drawing_size(width: int, height: int) -> tuple[int, int]:
    """Width and height of a picture's overlay: the picture's, reduced to at most 640 pixels a side."""
    shrink = min(1.0, _SIDE / max(width, height))
    return max(1, round(width * shrink)), max(1, round(height * shrink))


def downsample(
    plane: Float[Tensor, "channels height width"], size: tuple[int, int]
) -> Float[Tensor, "channels rows cols"]:
    """A picture's planes at this width and height."""
    return F.adaptive_avg_pool2d(plane, (size[1], size[0]))


def intersection_over_union(mask: Bool[ndarray, "rows cols"], silhouette: Bool[ndarray, "rows cols"]) -> float:
    return float((mask & silhouette).sum() / max(int((mask | silhouette).sum()), 1))


def overlay(
    shown: Float[Tensor, "3 rows cols"], parts: Int[ndarray, "rows cols"], mask: Bool[ndarray, "rows cols"] | None
) -> Image:
    """The picture under the mesh's outline (yellow), the outlines of its parts (orange) and the mask's (cyan)."""
    from PIL import Image as PillowImage

    pixels = np.array(picture(_exposed(shown).permute(1, 2, 0)))
    outlines = [(_borders(parts), _ORANGE), (_thickened(_borders(parts != NO_PART)), _YELLOW)]
    if mask is not None:
        outlines.insert(1, (_thickened(_borders(mask)), _CYAN))
    for line, color in outlines:
        pixels[line] = color
    return PillowImage.fromarray(pixels)


def contact_sheet(overlays: Sequence[Image], captions: Sequence[str]) -> Image:
    """Thumbnails of all overlays, each above its caption."""
    from PIL import Image as PillowImage
    from PIL import ImageDraw, ImageOps

    columns = min(_COLUMNS, len(overlays))
    width, height = _CELL
    rows = math.ceil(len(overlays) / columns)
    sheet = PillowImage.new("RGB", (columns * width, rows * (height + _CAPTION)), _WHITE)
    draw = ImageDraw.Draw(sheet)
    for number, (image, caption) in enumerate(zip(overlays, captions, strict=True)):
        left, top = number % columns * width, number // columns * (height + _CAPTION)
        sheet.paste(ImageOps.pad(image, _CELL, color=_WHITE), (left, top))
        draw.text((left + 4, top + height + 2), caption, fill=_GREY)
    return sheet


def _exposed(shown: Float[Tensor, "3 rows cols"]) -> Float[Tensor, "3 rows cols"]:
    # EXR files may have any scale, so that a fixed exposure could show them black or white
    bright = torch.quantile(shown.amax(dim=0), 0.98)
    return shown / bright.clamp(min=1e-6)


def _borders(values: ndarray) -> Bool[ndarray, "rows cols"]:
    """The pixels that differ from the one to their right or below."""
    found = np.zeros(values.shape, dtype=bool)
    found[:, :-1] |= values[:, :-1] != values[:, 1:]
    found[:-1] |= values[:-1] != values[1:]
    return found


def _thickened(line: Bool[ndarray, "rows cols"]) -> Bool[ndarray, "rows cols"]:
    """The lines, two pixels wide instead of one."""
    wide = line.copy()
    wide[1:] |= line[:-1]
    wide[:, 1:] |= line[:, :-1]
    return wide
