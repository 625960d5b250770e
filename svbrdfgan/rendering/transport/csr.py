"""The product of stored transports on the CPU, by SciPy's CSR matrices with 32-bit indices: faster than `index_add`.

It avoids torch's parallel loops: these are so short that their threads stall each other where other programs keep the
cores busy, which was seen to make a product fifty times slower.
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
"""Elements converted at a time; from 2^15 on, torch would use several threads."""


@dataclass(frozen=True, eq=False)
class CsrProduct:
    """A sparse product for each view and channel. The first product converts the weights to float32 and keeps them."""

    transports: tuple[LightTransport, ...]

    def picture(self, texels: Float[Tensor, "texels 3"]) -> Float[Tensor, "pixels 3"]:
        background = np.concatenate([view.background.numpy().reshape(-1, 3) for view in self.transports])
        return torch.from_numpy(self._add_product(background, texels))

    def linear(self, texels: Float[Tensor, "texels 3"]) -> Float[Tensor, "pixels 3"]:
        pixels = sum(len(view.start) - 1 for view in self.transports)
        return torch.from_numpy(self._add_product(np.zeros((pixels, 3), np.float32), texels))

    def _add_product(
        self, image: Float[ndarray, "pixels 3"], texels: Float[Tensor, "texels 3"]
    ) -> Float[ndarray, "pixels 3"]:
        """Adds T @ texels to the image, in place, and returns it."""
        values = _channels(texels)
        for matrix, weights, rows, columns in self._blocks():
            for channel, weight in enumerate(weights):
                matrix.data = weight
                image[rows, channel] += matrix @ values[channel, columns]
        return image

    def transposed(self, grad: Float[Tensor, "pixels 3"]) -> Float[Tensor, "texels 3"]:
        texels = np.empty((sum(view.texels for view in self.transports), 3), np.float32)
        values = _channels(grad)
        for matrix, weights, rows, columns in self._blocks():
            transposed = matrix.T
            for channel, weight in enumerate(weights):
                transposed.data = weight
                texels[columns, channel] = transposed @ values[channel, rows]
        return torch.from_numpy(texels)

    def _blocks(self) -> Iterator[tuple[csr_matrix, list[Float[ndarray, " entries"]], slice, slice]]:
        """Each view's matrix, the weights of each channel, and the view's rows (pixels) and columns (texels).

        The channels share their indices; the caller sets `matrix.data` to the weights of one.
        """
        pixel, texel = 0, 0
        for matrix, weights in self._matrices:
            pixels, texels = matrix.shape
            yield matrix, weights, slice(pixel, pixel + pixels), slice(texel, texel + texels)
            pixel, texel = pixel + pixels, texel + texels

    @cached_property
    def _matrices(self) -> list[tuple[csr_matrix, list[Float[ndarray, " entries"]]]]:
        return [_matrix(view) for view in self.transports]


def _matrix(view: LightTransport) -> tuple[csr_matrix, list[Float[ndarray, " entries"]]]:
    """T with the weights of the first channel, and the weights of all three."""
    # one matrix for three channels, since SciPy takes longer to make a matrix than to multiply by it
    weights = [_single(weight, view) for weight in view.weight.unbind(1)]
    indices, shape = (view.texel.numpy(), view.start.numpy()), (len(view.start) - 1, view.texels)
    return csr_matrix((weights[0], *indices), shape=shape, copy=False), weights


def _single(weight: Float[Tensor, " entries"], view: LightTransport) -> Float[ndarray, " entries"]:
    """One channel's weights in float32, multiplied by the view's scale."""
    # by torch, which converts half precision four times as fast as NumPy
    result = torch.empty(len(weight))
    for piece, target in zip(weight.split(_PIECE), result.split(_PIECE), strict=True):
        torch.mul(piece.float(), view.scale, out=target)
    return result.numpy()


def _channels(values: Float[Tensor, "n 3"]) -> Float[ndarray, "3 n"]:
    """Each channel contiguous."""
    return np.ascontiguousarray(values.detach().numpy().T)
