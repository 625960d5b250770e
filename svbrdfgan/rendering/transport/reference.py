"""The product of stored transports in torch, on any device: what the faster ones are tested against."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from svbrdfgan.rendering.transport.light_transport import LightTransport


@dataclass(frozen=True, eq=False)
class ReferenceProduct:
    """A gather and an `index_add` for each view. On CUDA `index_add` uses atomics, unless torch is deterministic."""

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
