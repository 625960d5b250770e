"""Rewrite a glTF document without compressed geometry: what Draco and meshopt packed becomes plain buffers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from svbrdfgan.errors import AssetError
from svbrdfgan.io.gltf_codecs.draco_primitives import DRACO, without_draco
from svbrdfgan.io.gltf_codecs.meshopt import decode
from svbrdfgan.io.gltf_codecs.plain import MAX_ELEMENTS, Json, NewBuffer, slice_of, without_extensions

MESHOPT = ("KHR_meshopt_compression", "EXT_meshopt_compression")


def decompressed(header: Json, buffers: list[bytes], where: str) -> tuple[Json, list[bytes], tuple[str, ...]]:
    """A header and buffers without Draco and meshopt, and a sentence for each thing that was done.

    The given header and buffers stay as they are; what has no compression is shared with them. Plain copies are in new
    buffers. The compressed bytes stay where they were, and so do the buffer views that only Draco used, so that indices
    stay valid. Fallback buffers of meshopt that nothing uses any more are dropped.

    Args:
        buffers: the bytes of each buffer of the header; empty for those without data.
        where: the file's name, for messages.

    Raises:
        AssetError: compressed data are broken, or claim too many elements; or DracoPy is not installed.
    """
    try:
        _check_counts(header)
        header, buffers, unpacked = _without_meshopt(header, buffers)
        header, buffers, decoded = without_draco(header, buffers)
    except AssetError as error:
        raise AssetError(f"{where}: {error}") from error
    except (ValueError, ArithmeticError) as error:
        raise AssetError(f"{where} has broken compressed geometry: {error}; export it again.") from error
    except (LookupError, TypeError, AttributeError) as error:
        raise AssetError(
            f"{where} describes its compressed geometry in a broken way ({error!r}); export it again."
        ) from error
    return without_extensions(header, (DRACO, *MESHOPT)), buffers, tuple(_sentences(unpacked, decoded))


def _sentences(unpacked: int, decoded: int) -> Iterator[str]:
    for count, noun, library in ((decoded, "primitive", "Draco"), (unpacked, "buffer view", "meshopt")):
        if count == 1:
            yield f"1 {noun} was compressed with {library}; it comes out uncompressed"
        elif count:
            yield f"{count} {noun}s were compressed with {library}; they come out uncompressed"


def _check_counts(header: Json) -> None:
    packed = [packing["count"] for view in header.get("bufferViews", []) if (packing := _packing(view))]
    largest = max([*packed, *(accessor["count"] for accessor in header.get("accessors", []))], default=0)
    if largest > MAX_ELEMENTS:
        raise AssetError(f"it claims {largest} elements in one accessor; wanted at most {MAX_ELEMENTS}.")


def _packing(view: Json) -> Json | None:
    extensions = view.get("extensions", {})
    return next((extensions[name] for name in MESHOPT if name in extensions), None)


def _without_meshopt(header: Json, buffers: list[bytes]) -> tuple[Json, list[bytes], int]:
    packed = {index: packing for index, view in enumerate(header.get("bufferViews", [])) if (packing := _packing(view))}
    if not packed:
        return header, buffers, 0
    new = NewBuffer(len(buffers))
    views = list(header["bufferViews"])
    for index, packing in packed.items():
        views[index] = without_extensions(views[index], MESHOPT) | new.add(_unpacked(packing, buffers, index))
    own = [without_extensions(buffer, MESHOPT) for buffer in header["buffers"]]
    changed = {**header, "bufferViews": views, "buffers": [*own, new.description()]}
    unused = {header["bufferViews"][index]["buffer"] for index in packed} - {view["buffer"] for view in views}
    fallbacks = {index for index in unused if own[index] != header["buffers"][index] or not buffers[index]}
    return *_without_buffers(changed, [*buffers, new.data()], fallbacks), len(packed)


def _unpacked(packing: Json, buffers: list[bytes], index: int) -> bytes:
    layout: dict[str, Any] = {"count": packing["count"], "stride": packing["byteStride"], "mode": packing["mode"]}
    try:
        return decode(slice_of(packing, buffers), filter=packing.get("filter", "NONE"), **layout)
    except ValueError as error:
        raise ValueError(f"meshopt's buffer view {index}: {error}") from error


def _without_buffers(header: Json, buffers: list[bytes], dropped: set[int]) -> tuple[Json, list[bytes]]:
    kept = [index for index in range(len(buffers)) if index not in dropped]
    place = {old: new for new, old in enumerate(kept)}
    views = [{**view, "buffer": place[view["buffer"]]} for view in header["bufferViews"]]
    descriptions = [header["buffers"][index] for index in kept]
    return {**header, "buffers": descriptions, "bufferViews": views}, [buffers[index] for index in kept]
