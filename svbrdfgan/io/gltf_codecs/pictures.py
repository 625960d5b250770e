"""Decode the pictures that glTF files contain: PNG, JPEG, WebP, and KTX2 with plain pixels."""

from __future__ import annotations

import struct
from io import BytesIO

from PIL import Image

from svbrdfgan.io.eight_bit import MOST_TEXELS, require_bytes

KTX2 = b"\xabKTX 20\xbb\r\n\x1a\n"
MODES = {9: "L", 15: "L", 23: "RGB", 29: "RGB", 37: "RGBA", 43: "RGBA"}
"""By Vulkan's number, the formats of 8 bits a channel, linear or sRGB, in Pillow's terms."""
UNDEFINED = 0
"""Vulkan's number of a format that only the file's description names: Basis Universal."""
BASIS_LZ, ZSTANDARD = 1, 2
"""How KTX2 compresses a level once more; 0 is not at all."""


class UnreadablePicture(ValueError):  # noqa: N818
    """A picture is broken, or of a format that cannot be decoded; says which."""


def decode_picture(data: bytes, mime: str | None) -> Image.Image:
    """The picture with its top row first; of KTX2, the largest level.

    Args:
        mime: what the file claims; the data decide, and it only serves the message.

    Raises:
        UnreadablePicture: the picture cannot be decoded.
    """
    if data.startswith(KTX2):
        return _ktx2(data)
    try:
        picture = Image.open(BytesIO(data), formats=("PNG", "JPEG", "WEBP"))
        _require_size(*picture.size)
        require_bytes(picture, len(data))
        picture.load()
    except (OSError, SyntaxError, ValueError, struct.error, Image.DecompressionBombError) as error:
        reason = f"a picture of type {mime or 'unknown'} cannot be read ({error}); wanted PNG, JPEG or WebP"
        raise UnreadablePicture(f"{reason}.") from error
    return picture


def _require_size(width: int, height: int) -> None:
    """Refuses a picture before it is decoded.

    Raises:
        UnreadablePicture: it has more than `MOST_TEXELS`.
    """
    if width * height > MOST_TEXELS:
        raise UnreadablePicture(f"it has {width} x {height} texels; wanted at most {MOST_TEXELS // 10**6} million")


def _ktx2(data: bytes) -> Image.Image:
    if len(data) < 104:
        raise UnreadablePicture("a KTX2 picture is cut short: it ends in its header.")
    format_, _, width, height, depth, layers, faces, _, scheme = struct.unpack_from("<9I", data, 12)
    if format_ == UNDEFINED or scheme == BASIS_LZ:
        raise UnreadablePicture(
            "a KTX2 picture is compressed with Basis Universal, which cannot be decoded; store it as PNG, JPEG or WebP."
        )
    if format_ not in MODES or scheme not in (0, ZSTANDARD):
        raise UnreadablePicture(f"a KTX2 picture has Vulkan's format {format_}; wanted 8 bits a channel, or no KTX2.")
    if depth or layers > 1 or faces != 1 or not width or not height:
        raise UnreadablePicture("a KTX2 picture is not one flat picture.")
    _require_size(width, height)
    start, length = struct.unpack_from("<2Q", data, 80)
    size = width * height * len(MODES[format_])
    level = data[start : start + length]
    pixels = _unpacked(level, size) if scheme == ZSTANDARD else level
    if len(pixels) != size:
        raise UnreadablePicture(f"a KTX2 picture of {width} x {height} has {len(pixels)} bytes; wanted {size}.")
    return Image.frombytes(MODES[format_], (width, height), pixels)


def _unpacked(level: bytes, size: int) -> bytes:
    try:
        import zstandard
    except ImportError as error:
        raise UnreadablePicture(
            "a KTX2 picture is packed by Zstandard; run `pip install svbrdfgan[gltf]` to read it."
        ) from error
    try:
        if zstandard.frame_content_size(level) not in (-1, size):  # -1: the frame does not say
            return b""
        return zstandard.ZstdDecompressor().decompress(level, max_output_size=size)
    except zstandard.ZstdError as error:
        raise UnreadablePicture(f"a KTX2 picture is broken: {error}.") from error
