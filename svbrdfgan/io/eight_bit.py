"""Pictures of any mode as bytes of RGB or RGBA, with row 0 at the bottom, as textures are in memory."""

from __future__ import annotations

from io import BytesIO
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

if TYPE_CHECKING:
    from PIL.Image import Image

Bytes = UInt8[ndarray, "rows cols channels"]

MOST_TEXELS = 100_000_000
"""Of a texture that stays in bytes."""
MOST_LINEAR = 8192 * 8192
"""Of a picture that becomes linear values, which take twelve bytes each: 0.8 GB, and 0.2 GB as it is decoded."""
_DEFLATED = 1032
"""Times that DEFLATE, in which PNG packs pixels of at least a bit, makes bytes fewer, at most (RFC 1951)."""


def require_bytes(picture: Image, size: int) -> None:
    """Refuses a PNG that claims more pixels than a file of this many bytes holds; Pillow would make the others black.

    Raises:
        ValueError: instead of a picture.
    """
    if picture.format == "PNG" and picture.width * picture.height / 8 > _DEFLATED * size:
        raise ValueError(f"it says that it has {picture.width} x {picture.height} pixels, which its bytes cannot hold")


def flipped_bytes(picture: Image) -> Bytes:
    """The bytes of the picture, RGBA if it has any kind of transparency, else RGB."""
    return np.asarray(eight_bit(picture))[::-1]


def resized_bytes(picture: Image, rows: int, cols: int) -> Bytes:
    """The bytes at that size: bilinear, and averaged where the picture becomes smaller.

    Channels are apart from each other, as they are to viewers: colours where alpha is 0 stay what they are.
    """
    from PIL import Image as PillowImage

    whole = eight_bit(picture)
    if whole.size != (cols, rows):
        smaller = whole.size[0] > cols or whole.size[1] > rows
        filter_ = PillowImage.Resampling.BOX if smaller else PillowImage.Resampling.BILINEAR
        channels = [channel.resize((cols, rows), filter_) for channel in whole.split()]
        whole = PillowImage.merge(whole.mode, channels)
    return np.asarray(whole)[::-1]


def png_bytes(texture: Bytes) -> bytes:
    """The PNG file of a texture, whose row 0 is at v = 0."""
    from PIL import Image as PillowImage

    stream = BytesIO()
    PillowImage.fromarray(np.ascontiguousarray(texture[::-1])).save(stream, format="PNG", compress_level=3)
    return stream.getvalue()


def eight_bit(picture: Image) -> Image:
    """The picture in RGB, or RGBA if it has transparency."""
    from PIL import Image as PillowImage

    if picture.mode.startswith("I"):  # 16-bit grey, which Pillow's convert would clip
        grey = np.clip(np.round(np.asarray(picture).astype(np.float32) / 257.0), 0, 255).astype(np.uint8)
        picture = PillowImage.fromarray(grey)
    alpha = "A" in picture.getbands() or "transparency" in picture.info
    return picture.convert("RGBA" if alpha else "RGB")
