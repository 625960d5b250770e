"""A picture of an asset from four sides, on which each part has the colour of its verdict, with a legend."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan.asset.asset import Asset
from svbrdfgan.asset.part_facts import Orientation
from svbrdfgan.asset.verdicts import Verdict
from svbrdfgan.geometry.normals import corner_normals
from svbrdfgan.io.atomic import atomic_path
from svbrdfgan.report.pictures import INK, PAPER, font, to_pillow
from svbrdfgan.report.uv_views import look, paint
from svbrdfgan.types import Part, Surface

if TYPE_CHECKING:
    from PIL.Image import Image

_SIDES = (("corner", 40, 18), ("opposite corner", 220, 18), ("side", 90, 4), ("from above", 90, 80))
"""Azimuth and elevation of each view, degrees."""
_SIZE = (640, 400)  # of a view; pixels, as all sizes
_GAP = 16
_LINE = 30  # of the legend

_COLORS = {
    "weathers": (0.80, 0.42, 0.16),
    "glass": (0.45, 0.75, 0.95),
    "lamp": (0.98, 0.86, 0.30),
    "tyre": (0.20, 0.21, 0.24),
    "rubber": (0.28, 0.36, 0.33),
    "wheel": (0.36, 0.38, 0.43),
    "rim": (0.58, 0.60, 0.66),
    "chrome": (0.84, 0.86, 0.90),
    "interior": (0.58, 0.42, 0.70),
    "mirror": (0.55, 0.88, 0.84),
    "plate": (0.93, 0.93, 0.82),
    "decal": (0.92, 0.55, 0.70),
    "ground": (0.72, 0.78, 0.66),
    "kept": (0.40, 0.66, 0.42),
}
"""sRGB of parts that weather, and of each kind that is kept."""


def write_part_views(
    path: Path, asset: Asset, verdicts: Sequence[Verdict], orientation: Orientation | None = None
) -> None:
    """Writes a .png or .jpg of the asset from four sides. Parts that weather are orange, and kept ones as their kind.

    Args:
        orientation: turns the file's axes to Y up and the nose at +Z; None if the file has them so.

    Raises:
        AssetError: the file cannot be written.
    """
    from PIL import Image as PillowImage
    from PIL import ImageDraw

    keys = list(dict.fromkeys(_key(each) for each in sorted(verdicts, key=lambda each: -each.area) if each.area > 0.0))
    width, height = 2 * _SIZE[0] + 3 * _GAP, 2 * (_SIZE[1] + _GAP) + _GAP + _LINE * (1 + (len(keys) - 1) // 4) + _GAP
    sheet = PillowImage.new("RGB", (width, height), PAPER)
    surface, colors = _surface(asset, verdicts, orientation), _face_colors(asset, verdicts)
    size = np.ptp(surface.positions, axis=0)
    across = 90 if orientation is None and size[0] > 1.3 * size[2] else 0  # the file's nose lies along X
    for number, (label, azimuth, elevation) in enumerate(_SIDES):
        corner = (_GAP + number % 2 * (_SIZE[0] + _GAP), _GAP + number // 2 * (_SIZE[1] + _GAP))
        sheet.paste(_view(surface, colors, azimuth + across, elevation), corner)
        ImageDraw.Draw(sheet).text((corner[0] + 8, corner[1] + 6), label, fill=INK, font=font(15))
    _legend(sheet, keys, verdicts, 2 * (_SIZE[1] + _GAP) + _GAP)
    with atomic_path(path) as temporary:
        sheet.save(temporary)


def _key(verdict: Verdict) -> str:
    return "weathers" if verdict.weathers else verdict.kind if verdict.kind in _COLORS else "kept"


def _face_colors(asset: Asset, verdicts: Sequence[Verdict]) -> Float[ndarray, "faces 3"]:
    """Each part's colour; neighbours that weather differ a little in brightness, so that parts can be told apart."""
    shade = 1.0 + 0.1 * np.sin(2.4 * np.arange(len(verdicts)))
    colors = np.array([_COLORS[_key(verdict)] for verdict in verdicts]) * shade[:, None]
    return np.asarray(np.clip(colors, 0.0, 1.0)[asset.face_piece])


def _surface(asset: Asset, verdicts: Sequence[Verdict], orientation: Orientation | None) -> Surface:
    """The asset's triangles without the ground, which would hide the rest; their UVs mean nothing."""
    mesh = asset.mesh
    positions = mesh.positions if orientation is None else mesh.positions @ orientation.T
    normals, faces = corner_normals(positions, mesh.faces), np.arange(3 * len(mesh.faces)).reshape(-1, 3)
    count = len(faces)
    surface = Surface(
        positions[mesh.faces].reshape(-1, 3),
        normals.reshape(-1, 3),
        np.zeros((3 * count, 2)),
        faces,
        np.zeros(count, np.int64),
        (Part("all"),),
        np.zeros(3 * count),
        np.arange(count),
        np.tile(np.eye(3), (count, 1, 1)),
    )
    ground = np.array([verdict.kind == "ground" for verdict in verdicts])[asset.face_piece]
    if not ground.any() or ground.all():
        return surface
    # faces keep their numbers: those of the ground become points
    spot = surface.positions[surface.faces[np.flatnonzero(~ground)[0], 0]]
    return replace(surface, positions=np.where(np.repeat(ground, 3)[:, None], spot, surface.positions))


def _view(surface: Surface, colors: Float[ndarray, "faces 3"], azimuth: float, elevation: float) -> Image:
    seen = look(surface, math.radians(azimuth), math.radians(elevation), *_SIZE)
    picture = paint(seen, np.ones(len(colors), bool), lambda places: colors[places.face])
    return to_pillow(torch.from_numpy(picture))


def _legend(sheet: Image, keys: Sequence[str], verdicts: Sequence[Verdict], top: int) -> None:
    from PIL import ImageDraw

    draw, step = ImageDraw.Draw(sheet), (sheet.width - 2 * _GAP) // 4
    for number, key in enumerate(keys):
        left, line = _GAP + number % 4 * step, top + number // 4 * _LINE
        rgb = tuple(round(255 * channel) for channel in _COLORS[key])
        draw.rectangle((left, line + 4, left + 18, line + 22), fill=rgb, outline=INK)
        share = sum(verdict.area for verdict in verdicts if _key(verdict) == key)
        text = (
            f"weathers: {share:.0%}"
            if key == "weathers"
            else f"{key}: {share:.1%}"
            if key == "kept"
            else f"kept, {key}: {share:.1%}"
        )
        draw.text((left + 26, line + 4), text, fill=INK, font=font(15))
