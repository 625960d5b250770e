"""Pictures of a weathered surface from the front and from behind, in one light."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.errors import AssetError
from svbrdfgan.io.image import save_image
from svbrdfgan.rendering.checked_renderer import CheckedRenderer
from svbrdfgan.rendering.compositing import over
from svbrdfgan.scene.subject import Subject
from svbrdfgan.types import Camera, Environment, Layer, Materials, Rendering, Surface, View

_PICTURE = (480, 300)
_FOV = math.radians(22.0)
_FROM = ((35.0, 12.0), (215.0, 12.0))
"""Azimuth and elevation in degrees: the nose and one side, then the tail and the other."""
_MARGIN = 1.08
_BRIGHTNESS = 0.8  # mean radiance of the light
_GREY = 0.35  # linear, of the background
_QUANTILE = 0.98
_BRIGHTEST = 0.9
"""Exposure puts the 98th percentile at 0.9 at most, so that pale paint does not become white."""


@dataclass(frozen=True, eq=False)
class Studio:
    """A renderer in a light, for pictures of surfaces with their nose at +Z.

    Attributes:
        environment: linear radiance, equirectangular; scaled to a fixed mean.

    Raises:
        AssetError: the light is black.
    """

    renderer: CheckedRenderer
    environment: Float[Tensor, "rows cols 3"]

    def __post_init__(self) -> None:
        if float(self.environment.mean()) <= 0:
            raise AssetError("the environment is black, so that nothing would be visible; choose another.")

    def stand(self, surface: Surface) -> Stand:
        """The surface in this light, to be shown in any materials."""
        return Stand(self, surface)


@dataclass(frozen=True, eq=False)
class Stand:
    """A surface in a studio."""

    studio: Studio
    surface: Surface

    @cached_property
    def _prepared(self) -> Any:
        return self.studio.renderer.prepare(self.surface)

    def show(self, materials: Materials, *, spp: int = 64, sides: int = 2) -> Rendering:
        """The surface from the front and, by default, from behind, side by side; linear.

        Raises:
            UnsupportedError: the renderer does not read one of the maps.
        """
        sky = self.studio.environment
        light = Environment(sky * (_BRIGHTNESS / float(sky.mean())))
        views = [View(_camera(self.surface, *angles), light, *_PICTURE) for angles in _FROM[:sides]]
        render = self.studio.renderer.render
        shown = [render(self._prepared, materials, view, spp=spp, seed=0) for view in views]
        image = torch.cat([side.image for side in shown], dim=1)
        return Rendering(image, torch.cat([side.coverage for side in shown], dim=1))

    def write(self, path: Path, materials: Materials, *, spp: int = 64) -> None:
        """Writes the picture of both sides on grey; .png or .jpg.

        Raises:
            AssetError: the file cannot be written.
        """
        (picture,) = developed([self.show(materials, spp=spp)])
        save_image(path, picture)


def developed(shown: Sequence[Rendering]) -> list[Float[Tensor, "height width 3"]]:
    """The pictures on grey, all with the exposure that none of them becomes white with; linear, on the CPU."""
    covered = torch.cat([picture.image[picture.coverage > 0].amax(dim=-1) for picture in shown])
    # every n-th pixel, since torch's quantile takes 16 million values at most
    brightest = torch.quantile(covered[:: 1 + len(covered) // 10_000_000], _QUANTILE)
    exposure, grey = (_BRIGHTEST / brightest).clamp(max=1), torch.full((3,), _GREY, device=covered.device)
    return [over(picture.image * exposure, picture.coverage, grey).cpu() for picture in shown]


def write_picture(
    path: Path,
    subject: Subject,
    layer: Layer,
    renderer: CheckedRenderer,
    environment: Float[Tensor, "rows cols 3"],
    maps: Mapping[str, float | None] | None = None,
    *,
    spp: int = 64,
) -> None:
    """Renders the weathered surface from the front and from behind, side by side on grey.

    Args:
        path: .png or .jpg.
        environment: linear radiance, equirectangular; scaled to a fixed mean.
        maps: as for `Subject.materials`.

    Raises:
        AssetError: the layer paints other maps, the light is black, or the file cannot be
            written.
        UnsupportedError: the renderer does not read one of the maps.
    """
    Studio(renderer, environment).stand(subject.surface).write(path, subject.materials(layer, maps), spp=spp)


def _camera(surface: Surface, azimuth: float, elevation: float) -> Camera:
    """The camera at these angles (degrees) that shows the surface centred and as large as the picture allows."""
    points = surface.positions
    angles, tangent, (width, height) = (math.radians(azimuth), math.radians(elevation)), math.tan(_FOV / 2), _PICTURE
    axes = Camera.orbit(*angles, 1.0, (0.0, 0.0, 0.0), _FOV).basis()
    target, distance = (points.min(axis=0) + points.max(axis=0)) / 2, 1.0
    for _ in range(4):  # perspective moves the centre when the distance changes; this converges fast
        right, top, nearer = axes @ (points - target).T
        distance = float(np.max(np.maximum(abs(right) * height / width, abs(top)) / tangent + nearer))
        seen = np.stack([right, top]) / (_MARGIN * distance - nearer)
        target = target + distance * (seen.min(axis=1) + seen.max(axis=1)) / 2 @ axes[:2]
    x, y, z = target.tolist()
    return Camera.orbit(*angles, _MARGIN * distance, (x, y, z), _FOV)
