"""A weathered mesh as files that any viewer shows."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.errors import AssetError
from svbrdfgan.io import linear_from_srgb, save_glb, save_image, save_texture
from svbrdfgan.protocols import Renderer
from svbrdfgan.rendering.compositing import RGBA, over
from svbrdfgan.scene.asset import Subject
from svbrdfgan.types import Camera, Environment, Materials, View

_PICTURE = (480, 300)
_FOV = math.radians(22.0)
_FROM = ((35.0, 12.0), (215.0, 12.0))
"""Azimuth and elevation, degrees: the nose and one side, the tail and the other."""
_MARGIN = 1.08
_BRIGHTNESS, _GREY = 0.8, 0.35
_NEARLY_ALL, _PALE = 0.98, 0.9
"""So much of the surface is darker than that; a brighter one is exposed less, lest pale paint be white."""


def write_weathered(
    path: Path, subject: Subject, layer: Float[Tensor, "rows cols channels"], maps: Mapping[str, float] | None = None
) -> Path:
    """Writes the surface as GLB, its layer composited over the learnable parts, and the layer alone as PNG beside it.

    Roughness and metallic are in the GLB as well. Each becomes a PNG beside it too, `NAME.roughness.png` and so on,
    whose numbers are those of the map and not sRGB.

    Args:
        maps: those that the layer paints beside base_color, with what lies beneath it.

    Returns:
        The path of the layer's PNG, which holds its RGBA.

    Raises:
        AssetError: the layer has channels for other maps, or the disk refuses.
    """
    materials = subject.materials({}, layer, maps)
    colors = {part: material.base_color for part, material in enumerate(materials.parts)}
    textures = {part: color for part, color in colors.items() if color.ndim == 3}
    save_glb(path, subject.surface, textures, _gloss(subject, materials) if maps else {})
    for name in maps or {}:
        values = materials[subject.learnable[0]].maps[name]
        save_texture(path.with_suffix(f".{name}.png"), linear_from_srgb(values.clamp(0, 1)))
    alone = path.with_suffix(".layer.png")
    save_texture(alone, layer[..., :RGBA])
    return alone


def write_picture(
    path: Path,
    subject: Subject,
    layer: Float[Tensor, "rows cols channels"],
    renderer: Renderer[Any],
    environment: Float[Tensor, "rows cols 3"],
    maps: Mapping[str, float] | None = None,
    *,
    spp: int = 64,
) -> None:
    """Renders the weathered surface from the front and from behind, side by side before grey.

    Args:
        path: .png or .jpg.
        environment: linear radiance all around; brightened or dimmed to one mean for all.
        maps: those that the layer paints beside base_color, with what lies beneath it.

    Raises:
        AssetError: the layer has channels for other maps, the light is black, or the disk refuses.
        UnsupportedError: the renderer does not read one of the maps.
    """
    mean = float(environment.mean())
    if mean <= 0:
        raise AssetError("the environment is black: nothing would be seen.")
    light = Environment(environment * (_BRIGHTNESS / mean))
    prepared, materials = renderer.prepare(subject.surface), subject.materials({}, layer, maps)
    grey = torch.full((3,), _GREY, device=renderer.device)
    views = [View(_camera(subject, *angles), light, *_PICTURE) for angles in _FROM]
    sides = [renderer.render(prepared, materials, view, spp=spp, seed=0) for view in views]
    image = torch.cat([side.image for side in sides], dim=1)
    coverage = torch.cat([side.coverage for side in sides], dim=1)
    brightest = torch.quantile(image[coverage > 0].amax(dim=-1), _NEARLY_ALL)
    save_image(path, over(image * (_PALE / brightest).clamp(max=1), coverage, grey).cpu())


def _camera(subject: Subject, azimuth: float, elevation: float) -> Camera:
    """Angles in degrees. The surface is in the middle of the picture and as large as it can be there."""
    points = subject.surface.positions
    angles, tangent, (width, height) = (math.radians(azimuth), math.radians(elevation)), math.tan(_FOV / 2), _PICTURE
    axes = Camera.orbit(*angles, 1.0, (0.0, 0.0, 0.0), _FOV).basis()
    target, distance = (points.min(axis=0) + points.max(axis=0)) / 2, 1.0
    for _ in range(4):
        right, top, nearer = axes @ (points - target).T
        distance = float(np.max(np.maximum(abs(right) * height / width, abs(top)) / tangent + nearer))
        seen = np.stack([right, top]) / (_MARGIN * distance - nearer)
        target = target + distance * (seen.min(axis=1) + seen.max(axis=1)) / 2 @ axes[:2]
    x, y, z = target.tolist()
    return Camera.orbit(*angles, _MARGIN * distance, (x, y, z), _FOV)


def _gloss(subject: Subject, materials: Materials) -> dict[int, Float[Tensor, "rows cols 2"]]:
    """Roughness and metallic of the learnable parts, which share one layer: 1 and 0 where it does not paint them."""
    painted = materials[subject.learnable[0]].maps
    rough, metallic = painted.get("roughness"), painted.get("metallic")
    shape = next(values.shape for values in (rough, metallic) if values is not None)
    both = [torch.ones(shape) if rough is None else rough, torch.zeros(shape) if metallic is None else metallic]
    return dict.fromkeys(subject.learnable, torch.cat(both, dim=-1))
