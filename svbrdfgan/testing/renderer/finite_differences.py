"""How the picture changes with each texel of base colour, by differences at the same seed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from torch import Tensor

from svbrdfgan.testing.renderer.cases import Picture, Stage

_STEP = 0.04


@dataclass(frozen=True, eq=False)
class Slopes:
    """What each texel of one part's base colour does to the picture, each channel to its own.

    Attributes:
        shape: of the base colour.
    """

    slope: Float[ndarray, "texels height width 3"]
    shape: tuple[int, ...]

    def pulled(self, grad: Picture) -> Float[ndarray, "*shape"]:
        """The gradient of sum(image * grad)."""
        return np.asarray(np.einsum("thwc,hwc->tc", self.slope, grad).reshape(self.shape))


def slopes(stage: Stage, part: int, *, spp: int, seed: int) -> Slopes:
    """The slopes of one part's base colour, by a rule exact for polynomials of the fourth degree: four bounces."""
    value = stage.setting.materials[part].base_color
    texels = range(value.numel() // 3)

    def picture(texel: int, steps: int) -> Picture:
        moved: Tensor = value.clone().reshape(-1, 3)
        moved[texel] += steps * _STEP
        return stage.image(stage.setting.with_map(part, "base_color", moved.reshape(value.shape)), spp=spp, seed=seed)

    def slope(texel: int) -> Picture:
        near, far = (picture(texel, steps) - picture(texel, -steps) for steps in (1, 2))
        return np.asarray((8.0 * near - far) / (12.0 * _STEP))

    return Slopes(np.stack([slope(texel) for texel in texels]), tuple(value.shape))
