"""Decode the buffer views of EXT_meshopt_compression and KHR_meshopt_compression.

The bitstreams are those of the extension's specification, appendix A; its appendix B has the filters.
"""

from __future__ import annotations

from array import array
from collections import deque

import numpy as np
from jaxtyping import UInt32
from numpy import ndarray

from svbrdfgan.io.gltf_codecs.meshopt_attributes import decode_attributes
from svbrdfgan.io.gltf_codecs.meshopt_filters import FILTER_STRIDES, filtered

CUT_SHORT = "the stream ends too early"
LEFT_OVER = "the stream has bytes left over"
WRAP = 0xFFFFFFFF
"""Indices wrap around at 32 bits."""


def decode(data: bytes, *, count: int, stride: int, mode: str, filter: str = "NONE") -> bytes:
    """The `count * stride` bytes of a buffer view.

    No memory is taken for elements that the stream is too short to hold: at best a byte of it gives a kilobyte.

    Args:
        data: exactly the compressed stream; it ends with a tail that is found from its end.
        stride: of an element, in bytes: 4 to 256 in fours for ATTRIBUTES, 2 or 4 for indices.
        mode: ATTRIBUTES, TRIANGLES or INDICES.
        filter: NONE, OCTAHEDRAL, QUATERNION, EXPONENTIAL or COLOR; of ATTRIBUTES alone.

    Raises:
        ValueError: the stream is broken, or the arguments do not fit each other; says why.
    """
    _check_layout(count, stride, mode, filter)
    if mode == "ATTRIBUTES":
        return filtered(decode_attributes(data, count, stride), filter).tobytes()
    indices = _triangles(data, count) if mode == "TRIANGLES" else _indices(data, count)
    return indices.astype("<u2" if stride == 2 else "<u4").tobytes()


def _check_layout(count: int, stride: int, mode: str, filter: str) -> None:
    strides = range(4, 257, 4) if mode == "ATTRIBUTES" else (2, 4)
    filters = FILTER_STRIDES if mode == "ATTRIBUTES" else {"NONE": strides}
    if mode not in ("ATTRIBUTES", "TRIANGLES", "INDICES"):
        raise ValueError(f"its mode is {mode!r}; known are ATTRIBUTES, TRIANGLES and INDICES")
    if filter not in filters:
        raise ValueError(f"its filter is {filter!r}; known for {mode} are {', '.join(filters)}")
    if stride not in strides or stride not in filters[filter]:
        raise ValueError(f"elements of {stride} bytes do not fit mode {mode} with filter {filter}")
    if count < 1 or (mode == "TRIANGLES" and count % 3):
        raise ValueError(f"{count} elements do not fit mode {mode}")


def _triangles(data: bytes, count: int) -> UInt32[ndarray, " count"]:
    codes, end = 1 + count // 3, len(data) - 16
    if data[:1] != b"\xe1":
        raise ValueError("a stream of triangles begins with the byte 0xe1")
    if end < codes:
        raise ValueError(CUT_SHORT)
    try:
        indices, position = _walk_triangles(data[1:codes], data, codes)
    except IndexError as error:
        raise ValueError("a triangle refers to an edge, a vertex or a byte that is not there") from error
    if position != end:
        raise ValueError(CUT_SHORT if position > end else LEFT_OVER)
    return np.frombuffer(indices, dtype=np.uint32)


def _walk_triangles(codes: bytes, data: bytes, position: int) -> tuple[array[int], int]:
    """The indices of all triangles, and where reading ended."""
    table = data[-16:]
    edges: deque[tuple[int, int]] = deque(maxlen=16)
    vertices: deque[int] = deque(maxlen=16)
    out = array("I")
    following = last = 0

    def explicit() -> int:
        nonlocal position, last
        value, position = _varint(data, position)
        last = (last + (~(value >> 1) if value & 1 else value >> 1)) & WRAP
        return last

    def corner(nibble: int) -> int:
        nonlocal following
        if 0 < nibble < 15:
            return vertices[nibble - 1]
        vertex = explicit() if nibble else following
        following += not nibble
        return vertex

    for code in codes:
        high, low = code >> 4, code & 15
        if high < 15:
            a, b = edges[high]
            if low == 0:
                c = following
                following += 1
            elif low < 13:
                c = vertices[low]
            else:
                c = explicit() if low == 15 else (last + 2 * low - 27) & WRAP  # 13 is the one before, 14 the one after
                last = c
            if not 0 < low < 13:
                vertices.appendleft(c)
        else:
            pair = table[low] if low < 14 else data[position]
            position += low >= 14
            following = following if low < 14 or pair else 0
            kinds = (15 if low == 15 else 0, pair >> 4, pair & 15)
            a, b, c = map(corner, kinds)
            vertices.extendleft(v for v, kind in zip((a, b, c), kinds, strict=True) if kind in (0, 15))
            edges.appendleft((b, a))
        edges.appendleft((c, b))
        edges.appendleft((a, c))
        out.extend((a, b, c))
    return out, position


def _varint(data: bytes, position: int) -> tuple[int, int]:
    """The number in up to five bytes of seven bits each, and the place after it."""
    value = 0
    for shift in range(0, 35, 7):
        byte = data[position]
        position += 1
        value |= (byte & 127) << shift
        if byte < 128:
            return value & WRAP, position
    raise ValueError("a number has more than five bytes")


def _indices(data: bytes, count: int) -> UInt32[ndarray, " count"]:
    if data[:1] != b"\xd1":
        raise ValueError("a stream of indices begins with the byte 0xd1")
    codes = _varints(np.frombuffer(data, np.uint8)[1 : max(len(data) - 4, 1)])
    if len(codes) != count:
        raise ValueError(CUT_SHORT if len(codes) < count else LEFT_OVER)
    deltas = (codes >> 2) ^ -((codes >> 1) & 1)
    out = np.empty(count, np.uint32)
    for baseline in (0, 1):
        mine = codes & 1 == baseline
        out[mine] = np.cumsum(deltas[mine], dtype=np.uint32)
    return out


def _varints(data: ndarray) -> UInt32[ndarray, " numbers"]:
    """All numbers of a sequence; see `_varint`."""
    ends = np.flatnonzero(data < 128)
    if len(data) and (not len(ends) or ends[-1] != len(data) - 1):
        raise ValueError(CUT_SHORT)
    starts = np.concatenate([[0], ends[:-1] + 1]) if len(ends) else ends
    lengths = ends - starts + 1
    if np.any(lengths > 5):
        raise ValueError("a number has more than five bytes")
    values = np.zeros(len(ends), np.uint32)
    for place in range(5):
        longer = lengths > place
        values[longer] |= (data[starts[longer] + place].astype(np.uint32) & 127) << np.uint32(7 * place)
    return values
