"""Exposes pictures of unknown light and exposure to the brightness of the lights that they train with.

A picture alone does not separate exposure, light and reflectance; the mesh's base material is taken as known. Each
picture is multiplied by one factor, which makes the median of its luminance relative to the unweathered mesh, rendered
under the mean of the pool's lights, equal to one. It is the median, since weathering may make paint many times
brighter: where more than half of the visible surface is nearly clean, the median is right and the mean is too high
(`docs/lab/own-pictures.md` has the numbers). Colour is kept.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.data.sampler import ConfigSampler
from svbrdfgan.errors import AssetError
from svbrdfgan.io.environment import load_environment
from svbrdfgan.io.image import luminance
from svbrdfgan.types import Rendering

_ROWS = 32
"""Rows of the mean light."""
_DRAWS = 512
"""Lights that the mean is taken over."""
_FULL = 0.99
"""Coverage from which a pixel counts as filled."""


def mean_light(sampler: ConfigSampler, folder: Path) -> Float[Tensor, "rows cols 3"]:
    """The mean of the lights that training draws from a data set's pool: maps, rotations and brightness."""
    rng = np.random.default_rng(0)
    small = {light.asset.path: _small(folder / light.asset.path) for light in sampler.environments}
    total = torch.zeros(_ROWS, 2 * _ROWS, 3)
    for _ in range(_DRAWS):
        drawn = sampler.draw_environment(rng)
        turn = -round(drawn.rotation_degrees / 360 * 2 * _ROWS)
        total += small[drawn.asset.path].roll(turn, dims=1) * drawn.scale
    return total / _DRAWS


def exposure_factor(photo: Rendering, clean: Rendering) -> float:
    """The factor that exposes a picture.

    Args:
        photo: the picture, premultiplied by its mask.
        clean: the rendered unweathered mesh, from the same camera.

    Raises:
        AssetError: no pixel is filled in both, or the picture is black there.
    """
    both = (photo.coverage > _FULL) & (clean.coverage > _FULL)
    target, given = (luminance(rendering.image) for rendering in (clean, photo))
    both &= target > 0
    if not both.any():
        raise AssetError("mask and mesh have no pixel in common: correct the camera or the mask.")
    ratio = float((given[both] / target[both]).median())
    if not ratio > 0:
        raise AssetError("the picture is black where it should show the mesh.")
    return 1.0 / ratio


def _small(path: Path) -> Float[Tensor, "rows cols 3"]:
    radiance = load_environment(path).permute(2, 0, 1)
    return F.adaptive_avg_pool2d(radiance, (_ROWS, 2 * _ROWS)).permute(1, 2, 0)
