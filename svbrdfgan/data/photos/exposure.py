"""The brightness of pictures whose light and exposure nobody knows, brought to that of the lights they train with.

Exposure cannot be told from light, nor light from reflectance, without something known: here the mesh's base material.
Each picture is multiplied so that the median, over the pixels that the object fills, of its luminance divided by that
of the unweathered mesh under the mean of the pool's lights becomes one. The median, since weathering may make paint
many times brighter: it is right, but for the light, where more than half of what is seen is nearly clean. The mean is
dragged along by the rest (`docs/own-pictures.md` has the numbers). Colour is left alone.
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
from svbrdfgan.io import load_environment, luminance
from svbrdfgan.types import Rendering

_ROWS, _DRAWS = 32, 512
_FULL = 0.99


def mean_light(sampler: ConfigSampler, folder: Path) -> Float[Tensor, "rows cols 3"]:
    """The mean of the lights that training draws from a data set's pool: maps, turns and brightness."""
    rng = np.random.default_rng(0)
    small = {light.asset.path: _small(folder / light.asset.path) for light in sampler.environments}
    total = torch.zeros(_ROWS, 2 * _ROWS, 3)
    for _ in range(_DRAWS):
        drawn = sampler.draw_environment(rng)
        turn = -round(drawn.rotation_degrees / 360 * 2 * _ROWS)
        total += small[drawn.asset.path].roll(turn, dims=1) * drawn.scale
    return total / _DRAWS


def exposure(taken: Rendering, clean: Rendering) -> float:
    """What to multiply a picture by.

    Args:
        taken: the picture, premultiplied by its mask.
        clean: the unweathered mesh, from the same camera.

    Raises:
        AssetError: they have no full pixel in common, or the picture is black there.
    """
    both = (taken.coverage > _FULL) & (clean.coverage > _FULL)
    wanted, found = (luminance(rendering.image) for rendering in (clean, taken))
    both &= wanted > 0
    if not both.any():
        raise AssetError("mask and mesh have no pixel in common: correct the camera or the mask.")
    ratio = float((found[both] / wanted[both]).median())
    if not ratio > 0:
        raise AssetError("the picture is black where it should show the mesh.")
    return 1.0 / ratio


def _small(path: Path) -> Float[Tensor, "rows cols 3"]:
    radiance = load_environment(path).permute(2, 0, 1)
    return F.adaptive_avg_pool2d(radiance, (_ROWS, 2 * _ROWS)).permute(1, 2, 0)
