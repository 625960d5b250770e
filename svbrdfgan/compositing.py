"""Laying things over each other: a layer over a base material, a picture over a background."""

from __future__ import annotations

from jaxtyping import Float
from torch import Tensor


def composite(base: Float[Tensor, "*shape 3"], layer: Float[Tensor, "*shape 4"]) -> Float[Tensor, "*shape 3"]:
    """The reflectance of `base` under a layer of straight-alpha linear RGBA (thesis 3.1). Shapes may broadcast."""
    color, alpha = layer[..., :3], layer[..., 3:]
    return base + alpha * (color - base)


def over(
    image: Float[Tensor, "*shape 3"], coverage: Float[Tensor, "*shape"], background: Float[Tensor, "*#shape 3"]
) -> Float[Tensor, "*shape 3"]:
    """A premultiplied picture of a surface before any background."""
    return image + (1.0 - coverage).unsqueeze(-1) * background
