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

from svbrdfgan.rendering.transport.light_transport import LightTransport

_PIECE = 2**14
"""Elements at a time; from 2^15 on, torch takes several threads."""


@dataclass(frozen=True, eq=False)
class HostProduct:
    """A product for each view and channel. Weights become single precision at the first one, and are kept."""

    transports: tuple[LightTransport, ...]

    def picture(self, texels: Float[Tensor, "texels 3"]) -> Float[Tensor, "pixels 3"]:
        background = np.concatenate([view.background.numpy().reshape(-1, 3) for view in self.transports])
        return torch.from_numpy(self._added(background, texels))

    def linear(self, texels: Float[Tensor, "texels 3"]) -> Float[Tensor, "pixels 3"]:
        pixels = sum(len(view.start) - 1 for view in self.transports)
        return torch.from_numpy(self._added(np.zeros((pixels, 3), np.float32), texels))

    def _added(
        self, image: Float[ndarray, "pixels 3"], texels: Float[Tensor, "texels 3"]
    ) -> Float[ndarray, "pixels 3"]:
        """The image, to which T @ texels is added in place."""
        values = _channels(texels)
        for matrix, weights, pixels, own in self._blocks():
            for channel, weight in enumerate(weights):
                matrix.data = weight
                image[pixels, channel] += matrix @ values[channel, own]
        return image

    def transposed(self, grad: Float[Tensor, "pixels 3"]) -> Float[Tensor, "texels 3"]:
        texels = np.empty((sum(view.texels for view in self.transports), 3), np.float32)
        values = _channels(grad)
        for matrix, weights, pixels, own in self._blocks():
            transposed = matrix.T
            for channel, weight in enumerate(weights):
                transposed.data = weight
                texels[own, channel] = transposed @ values[channel, pixels]
        return torch.from_numpy(texels)

    def _blocks(self) -> Iterator[tuple[csr_matrix, list[Float[ndarray, " entries"]], slice, slice]]:
        """For each view T, to be given the weights of a channel, which share their indices; its pixels, its texels."""
        pixel, texel = 0, 0
        for matrix, weights in self._matrices:
            pixels, texels = matrix.shape
            yield matrix, weights, slice(pixel, pixel + pixels), slice(texel, texel + texels)
            pixel, texel = pixel + pixels, texel + texels

    @cached_property
    def _matrices(self) -> list[tuple[csr_matrix, list[Float[ndarray, " entries"]]]]:
        return [_matrix(view) for view in self.transports]


def _matrix(view: LightTransport) -> tuple[csr_matrix, list[Float[ndarray, " entries"]]]:
    """T with the weights of one channel, and those of all three. SciPy takes longer to make a matrix than to use it."""
    weights = [_single(weight, view) for weight in view.weight.unbind(1)]
    indices, shape = (view.texel.numpy(), view.start.numpy()), (len(view.start) - 1, view.texels)
    return csr_matrix((weights[0], *indices), shape=shape, copy=False), weights


def _single(weight: Float[Tensor, " entries"], view: LightTransport) -> Float[ndarray, " entries"]:
    """A channel of its weights, scaled. In pieces by torch, which converts halves four times as fast as NumPy."""
    result = torch.empty(len(weight))
    for piece, target in zip(weight.split(_PIECE), result.split(_PIECE), strict=True):
        torch.mul(piece.float(), view.scale, out=target)
    return result.numpy()


def _channels(values: Float[Tensor, "n 3"]) -> Float[ndarray, "3 n"]:
    """Each channel in one piece."""
    return np.ascontiguousarray(values.detach().numpy().T)
