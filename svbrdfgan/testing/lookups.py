"""Bilinear lookups as sparse matrices: the kit's own, for textures and environments."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.sparse import csr_matrix


def bilinear(
    x: Float[ndarray, " points"],
    y: Float[ndarray, " points"],
    rows: int,
    cols: int,
    repeat: tuple[bool, bool],
    scale: Float[ndarray, " points"],
) -> csr_matrix:
    """(points, rows * cols): the weights of the four pixels around each point, given in pixels, times `scale`."""
    point, entries = np.arange(len(x)), []
    left, below = np.floor(x - 0.5), np.floor(y - 0.5)
    for col, row in ((left, below), (left + 1, below), (left, below + 1), (left + 1, below + 1)):
        weight = (1.0 - abs(x - 0.5 - col)) * (1.0 - abs(y - 0.5 - row)) * scale
        wrapped = [
            (i % n if again else np.clip(i, 0, n - 1)).astype(int)
            for i, n, again in ((row, rows, repeat[1]), (col, cols, repeat[0]))
        ]
        entries.append((weight, wrapped[0] * cols + wrapped[1]))
    weights, texels = (np.concatenate(each) for each in zip(*entries, strict=True))
    return csr_matrix((weights, (np.tile(point, 4), texels)), shape=(len(x), rows * cols))


def at_uv(
    values: Float[ndarray, "rows cols"], uv: Float[ndarray, "points 2"], repeat: tuple[bool, bool]
) -> Float[ndarray, " points"]:
    """A texture of one channel at some points."""
    rows, cols = values.shape
    lookup = bilinear(uv[:, 0] * cols, uv[:, 1] * rows, rows, cols, repeat, np.ones(len(uv)))
    return np.asarray(lookup @ values.reshape(-1))
