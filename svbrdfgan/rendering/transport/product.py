"""The product of stored transports with textures, and its transpose, which replace the renderer in training.

`csr.py` and `kernels.py` compute it faster on the CPU and on CUDA than `ReferenceProduct`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.autograd.function import once_differentiable

from svbrdfgan.rendering.transport.csr import CsrProduct
from svbrdfgan.rendering.transport.light_transport import LightTransport
from svbrdfgan.utils.copy_async import copy_async
from svbrdfgan.utils.triton_works import triton_works


class Product(Protocol):
    """Several transports on one device as one affine map, from all textures' texels to all images' pixels."""

    def picture(self, texels: Float[Tensor, "texels 3"]) -> Float[Tensor, "pixels 3"]:
        """background + T @ texels."""

    def linear(self, texels: Float[Tensor, "texels 3"]) -> Float[Tensor, "pixels 3"]:
        """T @ texels. Unlike a difference of two images, it keeps small values beside a bright background."""

    def transposed(self, grad: Float[Tensor, "pixels 3"]) -> Float[Tensor, "texels 3"]:
        """T^T @ grad."""


@dataclass(frozen=True, eq=False)
class TransportBatch:
    """Several views of the same film and texture size, on one device. Their entries are not copied.

    On CUDA gradients are summed by atomics and may differ between runs in the last bits, unless
    `torch.use_deterministic_algorithms` was set when the batch was made, which is several times slower.
    """

    transports: tuple[LightTransport, ...]
    product: Product

    @classmethod
    def stack(cls, transports: Sequence[LightTransport]) -> TransportBatch:
        """The batch of these views. It copies nothing and waits for no device.

        Raises:
            ValueError: their films or textures differ in size.
        """
        if len({(*t.coverage.shape, *t.texture_shape) for t in transports}) != 1:
            raise ValueError("a batch needs views of one film size and one texture size; make a batch for each")
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
        """The view of each texture."""
        owners = [view for view, t in enumerate(self.transports) for _ in t.parts]
        return copy_async(torch.tensor(owners, dtype=torch.long), self.transports[0].texel.device)

    def render(self, textures: Float[Tensor, "textures rows cols 3"]) -> Float[Tensor, "batch height width 3"]:
        """The images of these linear reflectances; differentiable in the textures, once.

        Raises:
            ValueError: the textures do not have the shape of the batch's.
        """
        return self._image(textures, self.product.picture)

    def linear(self, textures: Float[Tensor, "textures rows cols 3"]) -> Float[Tensor, "batch height width 3"]:
        """T @ textures: the images without the background; differentiable and refused as in `render`."""
        return self._image(textures, self.product.linear)

    def _image(self, textures: Tensor, forward: Callable[[Tensor], Tensor]) -> Tensor:
        first = self.transports[0]
        wanted = (sum(len(t.parts) for t in self.transports), *first.texture_shape, 3)
        if textures.shape != wanted:
            raise ValueError(f"got textures of shape {tuple(textures.shape)}; the batch needs {wanted}")
        texels = textures.reshape(-1, 3).float().contiguous()
        pixels: Tensor = _AffineMap.apply(texels, forward, self.product.transposed)
        return pixels.reshape(len(self.transports), *first.coverage.shape, 3)

    def transposed(self, images: Float[Tensor, "batch height width 3"]) -> Float[Tensor, "textures rows cols 3"]:
        """T^T @ images; differentiable in the images, once."""
        pixels = images.reshape(-1, 3).float().contiguous()
        texels: Tensor = _AffineMap.apply(pixels, self.product.transposed, self.product.linear)
        return texels.reshape(-1, *self.transports[0].texture_shape, 3)


class _AffineMap(torch.autograd.Function):
    """An affine map, with the transpose of its linear part for the gradient."""

    @staticmethod
    def forward(
        ctx: Any, values: Tensor, apply: Callable[[Tensor], Tensor], transpose: Callable[[Tensor], Tensor]
    ) -> Tensor:
        ctx.transpose = transpose
        return apply(values)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, grad: Tensor) -> tuple[Tensor, None, None]:
        return ctx.transpose(grad.contiguous()), None, None


@dataclass(frozen=True, eq=False)
class ReferenceProduct:
    """The product by torch's own operations, on any device: the definition that the others are tested against.

    It is a gather and an `index_add` for each view. On CUDA `index_add` uses atomics, unless torch is deterministic.
    """

    transports: tuple[LightTransport, ...]

    def picture(self, texels: Float[Tensor, "texels 3"]) -> Float[Tensor, "pixels 3"]:
        return self.linear(texels) + torch.cat([view.background.reshape(-1, 3) for view in self.transports])

    def linear(self, texels: Float[Tensor, "texels 3"]) -> Float[Tensor, "pixels 3"]:
        blocks = texels.split([view.texels for view in self.transports])
        return torch.cat([_linear(view, block) for view, block in zip(self.transports, blocks, strict=True)])

    def transposed(self, grad: Float[Tensor, "pixels 3"]) -> Float[Tensor, "texels 3"]:
        blocks = grad.chunk(len(self.transports))
        return torch.cat([_transposed(view, block) for view, block in zip(self.transports, blocks, strict=True)])


def _linear(view: LightTransport, texels: Float[Tensor, "texels 3"]) -> Float[Tensor, "pixels 3"]:
    terms = view.weight * texels[view.texel.long()] * view.scale
    return texels.new_zeros(len(view.start) - 1, 3).index_add_(0, _pixel(view), terms)


def _transposed(view: LightTransport, grad: Float[Tensor, "pixels 3"]) -> Float[Tensor, "texels 3"]:
    terms = view.weight * grad[_pixel(view)] * view.scale
    return grad.new_zeros(view.texels, 3).index_add_(0, view.texel.long(), terms)


def _pixel(view: LightTransport) -> Int[Tensor, " entries"]:
    """The pixel of each entry."""
    count = view.start.diff()
    return torch.repeat_interleave(torch.arange(len(count), device=count.device), count, output_size=len(view.texel))


def _product(transports: tuple[LightTransport, ...]) -> Product:
    """The fastest implementation that works on their device."""
    device = transports[0].texel.device
    if device.type == "cpu":
        return CsrProduct(transports)
    # the kernels sum gradients by atomics, so they are not taken where results must repeat bit for bit
    if device.type == "cuda" and not torch.are_deterministic_algorithms_enabled() and triton_works(device):
        from svbrdfgan.rendering.transport.kernels import TritonProduct

        return TritonProduct.of(transports)
    return ReferenceProduct(transports)
