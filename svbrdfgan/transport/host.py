"""The product of stored transports on the CPU: SciPy's compressed rows with 32-bit indices, faster than `index_add`.

None of torch's parallel loops is used: short as they are, they stall where other programs keep the cores busy.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray
from scipy.sparse import csr_matrix
from torch import Tensor

from svbrdfgan.transport.record import LightTransport

_PIECE = 2**14
"""Elements at a time; from 2^15 on, torch takes several threads."""


@dataclass(frozen=True, eq=False)
class HostProduct:
    """A product for each view and channel. Weights become single precision at the first one, and are kept."""

    transports: tuple[LightTransport, ...]

    def picture(self, texels: Float[Tensor, "texels 3"]) -> Float[Tensor, "pixels 3"]:
        image = np.concatenate([view.background.numpy().reshape(-1, 3) for view in self.transports])
        values = _channels(texels)
        for channel, pixels, own, matrix in self._blocks():
            image[pixels, channel] += matrix @ values[channel, own]
        return torch.from_numpy(image)

    def transposed(self, grad: Float[Tensor, "pixels 3"]) -> Float[Tensor, "texels 3"]:
        texels = np.empty((sum(view.texels for view in self.transports), 3), np.float32)
        values = _channels(grad)
        for channel, pixels, own, matrix in self._blocks():
            texels[own, channel] = matrix.T @ values[channel, pixels]
        return torch.from_numpy(texels)

    def _blocks(self) -> Iterator[tuple[int, slice, slice, csr_matrix]]:
        """A channel, a view's pixels and texels, and T there."""
        pixel, texel = 0, 0
        for matrices in self._matrices:
            pixels, texels = matrices[0].shape
            for channel, matrix in enumerate(matrices):
                yield channel, slice(pixel, pixel + pixels), slice(texel, texel + texels), matrix
            pixel, texel = pixel + pixels, texel + texels

    @cached_property
    def _matrices(self) -> list[list[csr_matrix]]:
        """T of red, green and blue, which share their indices, of each view."""
        return [_matrices(view) for view in self.transports]


def _matrices(view: LightTransport) -> list[csr_matrix]:
    shape, indices = (len(view.start) - 1, view.texels), (view.texel.numpy(), view.start.numpy())
    return [csr_matrix((_single(weight, view), *indices), shape=shape, copy=False) for weight in view.weight.unbind(1)]


def _single(weight: Float[Tensor, " entries"], view: LightTransport) -> Float[ndarray, " entries"]:
    """A channel of its weights, scaled. In pieces by torch, which converts halves four times as fast as NumPy."""
    result = torch.empty(len(weight))
    for piece, target in zip(weight.split(_PIECE), result.split(_PIECE), strict=True):
        torch.mul(piece.float(), view.scale, out=target)
    return result.numpy()


def _channels(values: Float[Tensor, "n 3"]) -> Float[ndarray, "3 n"]:
    """Each channel in one piece."""
    return np.ascontiguousarray(values.detach().numpy().T)
