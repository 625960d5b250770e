"""Plain views of a surface, from one side and from the other, coloured by what its map does: no light transport."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from svbrdfgan.geometry.normals import unit
from svbrdfgan.geometry.rasterize import rasterize
from svbrdfgan.types import Camera, Surface

Rgb = Float[ndarray, "*n 3"]
PAPER = np.array([1.0, 1.0, 1.0])
UNSEEN = np.array([0.62, 0.62, 0.64])
"""The colour of hidden parts, on which no map is shown."""
CHECKS = 32
_SMOOTH = 2  # samples along a side of a pixel
_MARGIN = 1.06


@dataclass(frozen=True, eq=False)
class Seen:
    """The places that samples show: those of a whole picture, top row first, or any of them.

    Attributes:
        face: of the surface, -1 where there is none.
        uv: of the place.
        light: from 0 to 1, how brightly it is lit.
    """

    face: Int[ndarray, "*n"]
    uv: Float[ndarray, "*n 2"]
    light: Float[ndarray, "*n"]


def look(surface: Surface, azimuth: float, elevation: float, width: int, height: int) -> Seen:
    """The surface from far away (orthographic; azimuth 0 is in front, radians), fitted into the picture."""
    frame = Camera.orbit(azimuth, elevation, 1.0, (0.0, 0.0, 0.0), 1.0).basis()
    turned = surface.positions @ frame.T
    used = turned[surface.faces].reshape(-1, 3)
    low, high = used.min(axis=0), used.max(axis=0)
    cols, rows = _SMOOTH * width, _SMOOTH * height
    pixel = _MARGIN * max((high[0] - low[0]) / cols, (high[1] - low[1]) / rows, 1e-300)
    screen = 0.5 + (turned[:, :2] - (low + high)[:2] / 2) / (pixel * np.array([cols, rows]))
    raster = rasterize(replace(surface, uv=screen, elevation=turned[:, 2]), rows, cols)
    seen = raster.interpolate(surface.faces, np.column_stack([surface.normals, surface.uv]))
    lit = np.abs(unit(seen[..., :3]) @ (unit(np.array([-0.35, 0.65, 0.75])) @ frame))
    return Seen(_upright(raster.face), _upright(seen[..., 3:]), _upright(0.35 + 0.65 * lit))


def paint(seen: Seen, shown: Bool[ndarray, " faces"], color: Callable[[Seen], Rgb]) -> Float[ndarray, "height width 3"]:
    """The picture, in sRGB: the colour, lit, where `shown`; grey where not, and paper where there is no surface."""
    covered = seen.face >= 0
    on_surface = Seen(seen.face[covered], seen.uv[covered], seen.light[covered])
    colors = np.where(shown[on_surface.face][:, None], color(on_surface), UNSEEN) * on_surface.light[:, None]
    picture = np.broadcast_to(PAPER, (*covered.shape, 3)).copy()
    picture[covered] = np.clip(colors, 0.0, 1.0)
    rows, cols = covered.shape
    lines = picture.reshape(rows // _SMOOTH, _SMOOTH, -1).mean(axis=1)
    return np.asarray(lines.reshape(len(lines), cols // _SMOOTH, _SMOOTH, 3).mean(axis=2))


def checker(uv: Float[ndarray, "*n 2"]) -> Rgb:
    """A checkerboard of 32 x 32 whose colour tells the place: hue runs along u, v from pale to deep."""
    u, v = np.moveaxis(np.clip(uv, 0.0, 1.0), -1, 0)
    dark = (np.floor(u * CHECKS) + np.floor(v * CHECKS)) % 2
    rgb = np.abs((6.0 * 0.85 * u[..., None] + (0.0, 4.0, 2.0)) % 6.0 - 3.0) - 1.0  # of the hue at full saturation
    pale = 1.0 - (0.25 + 0.6 * v[..., None]) * (1.0 - np.clip(rgb, 0.0, 1.0))
    return np.asarray(pale * (1.0 - 0.45 * dark[..., None]))


def _upright(values: ndarray) -> ndarray:
    """Rows from the top down."""
    return values[::-1]
