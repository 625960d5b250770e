"""The product of stored transports with textures, and its transpose: what replaces the renderer during training."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.autograd.function import FunctionCtx, once_differentiable

from svbrdfgan.rendering.transport.csr import HostProduct
from svbrdfgan.rendering.transport.light_transport import LightTransport
from svbrdfgan.rendering.transport.reference import PlainProduct
from svbrdfgan.utils.copy_async import copy_async
from svbrdfgan.utils.deprecation import renamed_attribute
from svbrdfgan.utils.triton_works import triton_works


class Product(Protocol):
    """Several transports as one affine map, of their textures' texels to their pictures' pixels, on one device."""

    def picture(self, texels: Float[Tensor, "texels 3"]) -> Float[Tensor, "pixels 3"]:
        """background + T @ texels."""
        ...

    def linear(self, texels: Float[Tensor, "texels 3"]) -> Float[Tensor, "pixels 3"]:
        """T @ texels. However bright the background, small values are not lost."""
        ...

    def transposed(self, grad: Float[Tensor, "pixels 3"]) -> Float[Tensor, "texels 3"]:
        """T^T @ grad."""
        ...


@dataclass(frozen=True, eq=False)
class TransportBatch:
    """Several views of the same film and texture size, on one device. Their entries are read where they lie.

    On CUDA gradients are summed by atomics, and may differ between runs in the last bits, unless
    `torch.use_deterministic_algorithms` was set when the batch was made; that is several times as slow.
    """

    transports: tuple[LightTransport, ...]
    product: Product

    guide = renamed_attribute("guide", "gbuffer")

    @classmethod
    def stack(cls, transports: Sequence[LightTransport]) -> TransportBatch:
        """The batch of these views. Nothing is copied, and no device waited for.

        Raises:
            ValueError: their films or textures differ in size.
        """
        if len({(*t.coverage.shape, *t.texture_shape) for t in transports}) != 1:
            raise ValueError("a batch wants views of one film size and one texture size; make a batch for each")
        return cls(tuple(transports), _product(tuple(transports)))

    @cached_property
    def coverage(self) -> Float[Tensor, "batch height width"]:
        return torch.stack([t.coverage for t in self.transports]).float()

    @cached_property
    def gbuffer(self) -> Float[Tensor, "batch height width 6"]:
        return torch.stack([t.gbuffer for t in self.transports]).float()

    @cached_property
    def background(self) -> Float[Tensor, "batch height width 3"]:
        return torch.stack([t.background for t in self.transports])

    @cached_property
    def owner(self) -> Int[Tensor, " textures"]:
        """For every texture, in order, the view that it belongs to."""
        owners = [view for view, t in enumerate(self.transports) for _ in t.parts]
        return copy_async(torch.tensor(owners, dtype=torch.long), self.transports[0].texel.device)

    def render(self, textures: Float[Tensor, "textures rows cols 3"]) -> Float[Tensor, "batch height width 3"]:
        """The pictures of these reflectances, differentiable in them (once).

        Raises:
            ValueError: other textures are wanted than these.
        """
        return self._shown(textures, background=True)

    def linear(self, textures: Float[Tensor, "textures rows cols 3"]) -> Float[Tensor, "batch height width 3"]:
        """T @ textures: the pictures without the background; likewise."""
        return self._shown(textures, background=False)

    def _shown(self, textures: Tensor, background: bool) -> Tensor:
        first = self.transports[0]
        wanted = (sum(len(t.parts) for t in self.transports), *first.texture_shape, 3)
        if textures.shape != wanted:
            raise ValueError(f"got textures of shape {tuple(textures.shape)}; the batch wants {wanted}")
        texels = textures.reshape(-1, 3).float().contiguous()
        pixels: Tensor = _Picture.apply(texels, self.product, background)
        return pixels.reshape(len(self.transports), *first.coverage.shape, 3)

    def transposed(self, images: Float[Tensor, "batch height width 3"]) -> Float[Tensor, "textures rows cols 3"]:
        """T^T @ images, differentiable in them (once)."""
        texels: Tensor = _Transposed.apply(images.reshape(-1, 3).float().contiguous(), self.product)
        return texels.reshape(-1, *self.transports[0].texture_shape, 3)


class _Picture(torch.autograd.Function):
    """T @ texels, with or without the background, and T^T for its gradient."""

    @staticmethod
    def forward(ctx: FunctionCtx, texels: Tensor, product: Product, background: bool) -> Tensor:
        ctx.product = product  # type: ignore[attr-defined]
        return product.picture(texels) if background else product.linear(texels)

    @staticmethod
    @once_differentiable
    def backward(ctx: FunctionCtx, grad: Tensor) -> tuple[Tensor, None, None]:
        product: Product = ctx.product  # type: ignore[attr-defined]
        return product.transposed(grad.contiguous()), None, None


class _Transposed(torch.autograd.Function):
    """T^T @ pixels, with T for its gradient."""

    @staticmethod
    def forward(ctx: FunctionCtx, pixels: Tensor, product: Product) -> Tensor:
        ctx.product = product  # type: ignore[attr-defined]
        return product.transposed(pixels)

    @staticmethod
    @once_differentiable
    def backward(ctx: FunctionCtx, grad: Tensor) -> tuple[Tensor, None]:
        product: Product = ctx.product  # type: ignore[attr-defined]
        return product.linear(grad.contiguous()), None


def _product(transports: tuple[LightTransport, ...]) -> Product:
    """The fastest that works on their device."""
    device = transports[0].texel.device
    if device.type == "cpu":
        return HostProduct(transports)
    if device.type == "cuda" and not torch.are_deterministic_algorithms_enabled() and triton_works(device):
        from svbrdfgan.rendering.transport.kernels import KernelProduct

        return KernelProduct.of(transports)
    return PlainProduct(transports)
