"""Undo the filters of the meshopt extensions, which shorten unit vectors, quaternions, floats and colours."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, UInt8
from numpy import ndarray

FILTER_STRIDES = {
    "NONE": range(4, 257, 4),
    "OCTAHEDRAL": (4, 8),
    "QUATERNION": (8,),
    "EXPONENTIAL": range(4, 257, 4),
    "COLOR": (4, 8),
}
"""By filter, the sizes that its elements may have, in bytes."""


def filtered(elements: UInt8[ndarray, "count stride"], filter: str) -> UInt8[ndarray, "count stride"]:
    """The elements without this filter. Those that no encoder makes come out as any values."""
    if filter == "NONE":
        return elements
    undo = {"OCTAHEDRAL": _octahedral, "QUATERNION": _quaternion, "EXPONENTIAL": _exponential, "COLOR": _color}[filter]
    with np.errstate(all="ignore"):
        return undo(np.ascontiguousarray(elements)).view(np.uint8)


def _octahedral(elements: UInt8[ndarray, "count stride"]) -> ndarray:
    values = elements.view("<i1" if elements.shape[1] == 4 else "<i2")
    x, y, one = values[:, :3].astype(np.float32).T
    x, y = x / one, y / one
    z = 1 - abs(x) - abs(y)
    fold = np.minimum(z, 0)
    vectors = np.stack([x - np.copysign(fold, x), y - np.copysign(fold, y), z], axis=1)
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.column_stack([_rounded(vectors, values.dtype), values[:, 3]])


def _quaternion(elements: UInt8[ndarray, "count 8"]) -> ndarray:
    values = elements.view("<i2")
    one = (values[:, 3:] | 3).astype(np.float32)
    others = values[:, :3] / one * np.float32(np.sqrt(0.5))
    largest = np.sqrt(np.maximum(0, 1 - np.sum(others**2, axis=1, keepdims=True)))
    places = ((values[:, 3:] & 3) + np.arange(4)) % 4
    out = np.empty_like(values)
    np.put_along_axis(out, places, _rounded(np.column_stack([largest, others]), values.dtype), axis=1)
    return out


def _exponential(elements: UInt8[ndarray, "count stride"]) -> Float32[ndarray, "count numbers"]:
    values = elements.view("<i4")
    return np.ldexp(((values << 8) >> 8).astype("<f4"), values >> 24)


def _color(elements: UInt8[ndarray, "count stride"]) -> ndarray:
    unsigned = elements.view("<u1" if elements.shape[1] == 4 else "<u2")
    signed = elements.view("<i1" if elements.shape[1] == 4 else "<i2")
    alpha = unsigned[:, 3].astype(np.int32)
    luma, orange, green = unsigned[:, 0].astype(np.int32), *signed[:, 1:3].astype(np.int32).T
    full = (1 << np.frexp(alpha.astype(np.float32))[1]) - 1
    alpha &= full >> 1
    colors = np.stack([luma + orange - green, luma + green, luma - orange - green, alpha << 1 | alpha & 1], axis=1)
    return _rounded(colors / np.maximum(full, 1).astype(np.float32)[:, None], unsigned.dtype)


def _rounded(values: ndarray, dtype: np.dtype) -> ndarray:
    """Values in [-1, 1] as normalised integers; halves go away from zero, and what is no number becomes zero."""
    scaled = np.nan_to_num(values * np.float32(np.iinfo(dtype).max))
    whole = np.trunc(scaled + np.copysign(np.float32(0.5), scaled))
    return np.clip(whole, np.iinfo(dtype).min, np.iinfo(dtype).max).astype(dtype)
