"""Decode vertex attributes of the meshopt extensions: deltas of bytes, packed in groups of 16 elements.

How long a group is depends on its content. So the lengths that a group would have at each byte of the stream are
computed first, for all places at once; then one short loop finds where the groups are; then all are unpacked together.
"""

from __future__ import annotations

from array import array

import numpy as np
from jaxtyping import Int, UInt8
from numpy import ndarray

GROUP = 16
RAW = 8
"""Bits of a delta that is stored as a whole byte."""
PADDING = 512
"""Bytes after the stream: more than the longest run of 16 groups, so that the loop may check its bounds once a run."""
CHUNK = 1 << 16
"""Groups that are unpacked at once."""

BITS_OF_VERSION_0 = (0, 2, 4, RAW)
BITS_OF_CONTROL = ((0, 1, 2, 4), (1, 2, 4, RAW))
ZERO, LITERAL = 2, 3
"""The further controls of version 1: all deltas are zero, or stored as bytes."""

CHANNEL_TYPES = ("<u1", "<u2", "<u4")
"""The numbers of which a channel, which has four bytes, stores differences."""


def decode_attributes(data: bytes, count: int, stride: int) -> UInt8[ndarray, "count stride"]:
    """The elements as bytes, before any filter.

    Raises:
        ValueError: the stream is broken.
    """
    if data[:1] not in (b"\xa0", b"\xa1"):
        raise ValueError("a stream of attributes begins with the byte 0xa0 or 0xa1")
    version = data[0] & 1
    tail = stride + version * stride // 4
    end = len(data) - max(tail, 24 if version else 32)
    padded = np.concatenate([np.frombuffer(data, np.uint8), np.zeros(PADDING, np.uint8)])
    bits, starts = _locate(padded, (count, stride), version, end)
    deltas = _in_rows(_unpack(padded, bits, starts), count, stride)
    channels = data[len(data) - tail + stride :] if version else bytes(stride // 4)
    return _accumulated(deltas, data[len(data) - tail :][:stride], channels)


def block_size(stride: int) -> int:
    """The elements in a block; the last may have fewer."""
    return min(8192 // stride & -GROUP, 256)


def _locate(
    data: UInt8[ndarray, " bytes"], shape: tuple[int, int], version: int, end: int
) -> tuple[UInt8[ndarray, " groups"], Int[ndarray, " groups"]]:
    """The bits of a delta in each group, and where the group begins, in the order of the stream."""
    count, stride = shape
    text, lengths = data.tobytes(), _group_lengths(data)
    bits, starts = array("B"), array("q")
    position = 1
    for first in range(0, count, block_size(stride)):
        elements = min(block_size(stride), count - first)
        controls = text[position : position + stride // 4]
        position += version * stride // 4
        for byte in range(stride):
            if position > end:
                raise ValueError("the stream ends too early")
            control = controls[byte // 4] >> 2 * (byte % 4) & 3 if version else -1
            run, position = _run(text, position, elements, control, lengths)
            bits.extend(run[0])
            starts.extend(run[1])
    if position != end:
        raise ValueError("the stream ends too early" if position > end else "the stream has bytes left over")
    return np.frombuffer(bits, np.uint8), np.frombuffer(starts, np.int64)


def _run(
    text: bytes, position: int, elements: int, control: int, lengths: dict[int, bytes]
) -> tuple[tuple[list[int], list[int]], int]:
    """The groups of one byte of a block's elements: their bits and starts; and the place after them."""
    groups = -(-elements // GROUP)
    if control in (ZERO, LITERAL):
        places = list(range(position, position + GROUP * groups, GROUP))
        return ([RAW if control == LITERAL else 0] * groups, places), position + elements * (control == LITERAL)
    table = BITS_OF_CONTROL[control] if control >= 0 else BITS_OF_VERSION_0
    bits = [table[text[position + group // 4] >> 2 * (group % 4) & 3] for group in range(groups)]
    position += -(-groups // 4)
    places = []
    for width in bits:
        places.append(position)
        position += lengths[width][position]
    return (bits, places), position


def _group_lengths(data: UInt8[ndarray, " bytes"]) -> dict[int, bytes]:
    """The bytes of a group that begins at each place, for each number of bits."""
    lengths = {0: bytes(len(data)), RAW: bytes([GROUP]) * len(data)}
    for bits in (1, 2, 4):
        escapes = (_codes(bits) == (1 << bits) - 1).sum(axis=1)
        before = np.concatenate([[0], np.cumsum(escapes[data])])
        width = GROUP * bits // 8
        lengths[bits] = (before[width:] - before[:-width] + width).astype(np.uint8).tobytes()
    return lengths


def _codes(bits: int) -> UInt8[ndarray, "256 codes"]:
    """The deltas that a byte packs: the highest bits first, but single bits the lowest first."""
    shifts = np.arange(0, 8, bits)[:: 1 if bits == 1 else -1]
    return (np.arange(256)[:, None] >> shifts & (1 << bits) - 1).astype(np.uint8)


def _unpack(
    data: UInt8[ndarray, " bytes"], bits: UInt8[ndarray, " groups"], starts: Int[ndarray, " groups"]
) -> UInt8[ndarray, "groups 16"]:
    out = np.zeros((len(bits), GROUP), np.uint8)
    for width in (1, 2, 4, RAW):
        chosen = np.flatnonzero(bits == width)
        for some in np.array_split(chosen, len(chosen) // CHUNK + 1):
            out[some] = _unpacked(data, starts[some], width)
    return out


def _unpacked(
    data: UInt8[ndarray, " bytes"], starts: Int[ndarray, " groups"], bits: int
) -> UInt8[ndarray, "groups 16"]:
    """The deltas of groups of one width; a delta with all bits set is an escape: its byte follows the group."""
    width = GROUP * bits // 8
    packed = data[starts[:, None] + np.arange(width)]
    if bits == RAW:
        return packed
    codes = _codes(bits)[packed].reshape(-1, GROUP)
    escaped = codes == (1 << bits) - 1
    places = starts[:, None] + width - 1 + np.cumsum(escaped, axis=1)
    return np.where(escaped, data[places], codes)


def _in_rows(groups: UInt8[ndarray, "groups 16"], count: int, stride: int) -> UInt8[ndarray, "stride count"]:
    """The deltas of each byte of the elements, from groups that are ordered by block first."""
    whole = count // block_size(stride)
    split = whole * stride * block_size(stride) // GROUP
    blocks = groups[:split].reshape(whole, stride, -1).transpose(1, 0, 2).reshape(stride, -1) if whole else groups[:0]
    rest = groups[split:].reshape(stride, -1)
    return np.concatenate([blocks.reshape(stride, -1), rest], axis=1)[:, :count] if whole else rest[:, :count]


def _accumulated(
    deltas: UInt8[ndarray, "stride count"], first: bytes, channels: bytes
) -> UInt8[ndarray, "count stride"]:
    """The elements of which these are the differences; `first` is what the first element is compared with."""
    out = np.empty(deltas.shape[::-1], np.uint8)
    for start, channel in zip(range(0, len(deltas), 4), channels, strict=True):
        mode, rotation = channel & 15, channel >> 4
        if mode >= len(CHANNEL_TYPES) or (rotation and mode < 2):
            raise ValueError(f"a channel has the unknown mode {channel:#04x}")
        numbers = np.ascontiguousarray(deltas[start : start + 4].T).view(CHANNEL_TYPES[mode])
        base = np.frombuffer(first[start : start + 4], CHANNEL_TYPES[mode])
        sums = _sums(numbers, base) if mode < 2 else _xors(numbers, base, rotation)
        out[:, start : start + 4] = sums.view(np.uint8)
    return out


def _sums(deltas: ndarray, base: ndarray) -> ndarray:
    signed = (deltas >> 1) ^ -(deltas & 1)
    return np.cumsum(signed, axis=0, dtype=deltas.dtype) + base


def _xors(deltas: ndarray, base: ndarray, rotation: int) -> ndarray:
    turned = (deltas >> np.uint32(rotation)) | (deltas << np.uint32((32 - rotation) & 31))  # encoders turn left
    return np.bitwise_xor.accumulate(turned, axis=0) ^ base
