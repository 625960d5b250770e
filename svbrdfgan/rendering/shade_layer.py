"""Pictures from stored light as a differentiable torch function."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from svbrdfgan.rendering.checked_renderer import CheckedLight, CheckedRenderer


def shade(
    renderer: CheckedRenderer,
    lights: Sequence[CheckedLight],
    textures: Float[Tensor, "textures rows cols channels"],
    *,
    maps: Sequence[str],
    visit: int,
    seed: int,
) -> Float[Tensor, "views height width 3"]:
    """`DeferredRenderer.shade`, differentiable in the textures, once."""

    def call(values: Tensor) -> tuple[Tensor, Callable[[Tensor], Tensor]]:
        return renderer.shade(lights, values, maps=maps, visit=visit, seed=seed)

    images: Tensor = _Shade.apply(textures, call)
    return images


class _Shade(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, textures: Tensor, call: Callable[[Tensor], tuple[Tensor, Any]]) -> Tensor:
        images, pullback = call(textures.detach())
        ctx.pullback, ctx.device = pullback, textures.device
        return images.to(textures.device)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, grad_images: Tensor) -> tuple[Tensor, None]:
        return ctx.pullback(grad_images).to(ctx.device), None
