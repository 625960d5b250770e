"""Shows a light as film crews record it: a chrome ball and a grey one, as a camera would see them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan.data.photos.overlay import downsample
from svbrdfgan.io.image import picture
from svbrdfgan.types import Camera, Environment

if TYPE_CHECKING:
    from PIL.Image import Image

_GREY = 0.18
_SHOWN = 0.45
"""What the brightest part of the grey ball is exposed to."""
_SMOOTH_ROWS = 16
"""Rows of the map whose light the grey ball gathers."""
_GAP = 0.06
"""Around a ball, as a share of its column."""
_BACKGROUND = 1.0


def beside(shown: Image, light: Environment, camera: Camera) -> Image:
    """The picture with a column at its right: the chrome ball above the grey one."""
    from PIL import Image as PillowImage

    width = max(16, shown.height // 3)
    side = max(8, round(width * (1 - 2 * _GAP)))
    balls = [picture(torch.from_numpy(ball).float()) for ball in light_balls(light, camera, side)]
    whole = PillowImage.new("RGB", (shown.width + width, shown.height), "white")
    whole.paste(shown, (0, 0))
    for number, ball in enumerate(balls):
        whole.paste(ball, (shown.width + (width - side) // 2, number * width + (width - side) // 2))
    return whole


def light_balls(
    light: Environment, camera: Camera, side: int
) -> tuple[Float[ndarray, "side side 3"], Float[ndarray, "side side 3"]]:
    """A perfect mirror and matt 18 % grey, seen from far away, equally exposed; linear, on white.

    Args:
        camera: where it looks from; the balls do not depend on its distance.
        side: of both pictures, pixels.
    """
    x, y = np.meshgrid(*[(np.arange(side) + 0.5) / side * 2 - 1] * 2)
    inside = x * x + y * y < 1
    near = np.sqrt(np.maximum(1 - x * x - y * y, 0))
    normal = np.stack([x, -y, near], axis=-1)
    basis = camera.basis()
    towards = np.array([0.0, 0.0, 1.0])
    mirrored = (2 * near[..., None] * normal - towards) @ basis
    chrome = _seen(light, mirrored)
    grey = _GREY * _irradiance(light, normal @ basis) / math.pi
    exposure = _SHOWN / max(float(grey[inside].max()), 1e-9)
    chrome, grey = (np.where(inside[..., None], ball * exposure, _BACKGROUND) for ball in (chrome, grey))
    return chrome, grey


def _seen(light: Environment, direction: Float[ndarray, "rows cols 3"]) -> Float[ndarray, "rows cols 3"]:
    """The radiance that comes from each direction: that of the pixel there."""
    rows, cols = light.radiance.shape[:2]
    polar = np.arccos(np.clip(direction[..., 1], -1, 1))
    around = np.arctan2(direction[..., 0], -direction[..., 2]) + light.rotation
    row = np.clip((polar / math.pi * rows).astype(int), 0, rows - 1)
    col = np.floor((around / (2 * math.pi) + 0.5) * cols).astype(int) % cols
    radiance: Float[ndarray, "rows cols 3"] = light.radiance.numpy()[row, col]
    return radiance


def _irradiance(light: Environment, normal: Float[ndarray, "rows cols 3"]) -> Float[ndarray, "rows cols 3"]:
    """The irradiance of surfaces with these normals."""
    rows, cols = _SMOOTH_ROWS, 2 * _SMOOTH_ROWS
    radiance = downsample(light.radiance.permute(2, 0, 1), (cols, rows)).permute(1, 2, 0).double().numpy()
    polar = (np.arange(rows) + 0.5) / rows * math.pi
    around = 2 * math.pi * ((np.arange(cols) + 0.5) / cols - 0.5) - light.rotation
    flat = np.sin(polar)[:, None]
    direction = np.stack(
        [flat * np.sin(around), np.broadcast_to(np.cos(polar)[:, None], (rows, cols)), -flat * np.cos(around)], axis=-1
    )
    solid_angle = 2 * math.pi / cols * math.pi / rows * flat
    cosine = np.maximum(np.einsum("ijd,rcd->ijrc", normal, direction), 0)
    irradiance: Float[ndarray, "rows cols 3"] = np.einsum("ijrc,rcd->ijd", cosine, radiance * solid_angle[..., None])
    return irradiance
