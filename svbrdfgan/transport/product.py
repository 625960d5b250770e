"""The product of stored transports with textures, and its transpose: what replaces the renderer during training."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray
from scipy.sparse import csc_matrix, csr_matrix
from torch import Tensor
from torch.autograd.function import FunctionCtx, once_differentiable

from svbrdfgan.transport.record import LightTransport


@dataclass(frozen=True, eq=False)
class TransportBatch:
    """Several views of the same film and texture size as one block-diagonal transport.

    Attributes:
        start, texel, weight: as in `LightTransport`, with the pixels and texels of all views counted through.
        background, coverage, guide: one picture each for every view.
        owner: for every texture, in order, the view that it belongs to.
    """

    start: Int[Tensor, " pixels+1"]
    texel: Int[Tensor, " entries"]
    weight: Float[Tensor, "entries 3"]
    background: Float[Tensor, "batch height width 3"]
    coverage: Float[Tensor, "batch height width"]
    guide: Float[Tensor, "batch height width 6"]
    owner: Int[Tensor, " textures"]

    @classmethod
    def stack(cls, transports: Sequence[LightTransport]) -> TransportBatch:
        """The batch of these views, on their device, with weights in single precision."""
        device = transports[0].texel.device
        entries = np.cumsum([0] + [len(t.texel) for t in transports])
        texels = np.cumsum([0] + [t.texels for t in transports])
        if max(entries[-1], texels[-1]) >= 2**31:
            raise ValueError("the batch has too many transport entries for 32-bit indices; use a smaller batch")
        starts = [t.start[:-1] + int(first) for t, first in zip(transports, entries, strict=False)]
        end = torch.tensor([int(entries[-1])], dtype=torch.int32, device=device)
        owners = [b for b, t in enumerate(transports) for _ in t.parts]
        return cls(
            start=torch.cat([*starts, end]),
            texel=torch.cat([t.texel + int(first) for t, first in zip(transports, texels, strict=False)]),
            weight=torch.cat([t.weight.float() * t.scale for t in transports]),
            background=torch.stack([t.background.float() for t in transports]),
            coverage=torch.stack([t.coverage.float() for t in transports]),
            guide=torch.stack([t.guide.float() for t in transports]),
            owner=torch.tensor(owners, device=device),
        )

    def render(self, textures: Float[Tensor, "textures rows cols 3"]) -> Float[Tensor, "batch height width 3"]:
        """The pictures of these reflectances, differentiable in them (once)."""
        product: Tensor = _Product.apply(textures.reshape(-1, 3).float(), self)
        return self.background + product.reshape(self.background.shape)

    def multiply(self, texels: Float[Tensor, "texels 3"]) -> Float[Tensor, "pixels 3"]:
        """T @ texels."""
        if texels.device.type == "cpu":
            return _channelwise(self._matrices(len(texels)), texels)
        picked = self.weight * texels[self.texel.long()]
        return texels.new_zeros(len(self.start) - 1, 3).index_add_(0, self._pixel(), picked)

    def multiply_transposed(self, pixels: Float[Tensor, "pixels 3"], texels: int) -> Float[Tensor, "texels 3"]:
        """T^T @ pixels, for textures of so many texels."""
        if pixels.device.type == "cpu":
            return _channelwise([matrix.T for matrix in self._matrices(texels)], pixels)
        return pixels.new_zeros(texels, 3).index_add_(0, self.texel.long(), self.weight * pixels[self._pixel()])

    def _pixel(self) -> Int[Tensor, " entries"]:
        counts = torch.diff(self.start)
        return torch.repeat_interleave(
            torch.arange(len(counts), device=counts.device), counts, output_size=len(self.texel)
        )

    def _matrices(self, texels: int) -> list[csr_matrix]:
        """T of red, green and blue, which share their indices: SciPy's 32-bit CSR, faster than index_add."""
        shape = (len(self.start) - 1, texels)
        indices = (self.texel.numpy(), self.start.numpy())
        return [csr_matrix((channel, *indices), shape=shape, copy=False) for channel in self._weights]

    @cached_property
    def _weights(self) -> list[Float[ndarray, " entries"]]:
        """Red, green and blue of `weight`, kept for the backward pass and for the next forward one."""
        return _columns(self.weight)


def _channelwise(matrices: Sequence[csr_matrix | csc_matrix], values: Float[Tensor, "n 3"]) -> Float[Tensor, "m 3"]:
    return torch.stack([torch.from_numpy(m @ c) for m, c in zip(matrices, _columns(values), strict=True)], dim=1)


def _columns(values: Float[Tensor, "n 3"]) -> list[Float[ndarray, " n"]]:
    """Each channel in one piece; copied singly, since torch transposes a tall matrix some nine times as slowly."""
    return [channel.contiguous().numpy() for channel in values.detach().unbind(1)]


class _Product(torch.autograd.Function):
    """T @ texels, with T^T for its gradient."""

    @staticmethod
    def forward(ctx: FunctionCtx, texels: Tensor, batch: TransportBatch) -> Tensor:
        ctx.batch, ctx.texels = batch, len(texels)  # type: ignore[attr-defined]
        return batch.multiply(texels)

    @staticmethod
    @once_differentiable
    def backward(ctx: FunctionCtx, grad: Tensor) -> tuple[Tensor, None]:
        batch: TransportBatch = ctx.batch  # type: ignore[attr-defined]
        return batch.multiply_transposed(grad.contiguous(), ctx.texels), None  # type: ignore[attr-defined]
