"""How much memory a picture takes while it is rendered and written."""

from __future__ import annotations

from svbrdfgan.geometry.layers import surface_bytes
from svbrdfgan.utils.memory import most_that_fits, require_memory

_FLOAT_PIXEL = 52  # bytes of a pixel as radiance and coverage, and of their copies while an EXR file is written
_BYTE_PIXEL = 104  # bytes of a pixel that also becomes sRGB, of PNG and JPEG files


def picture_bytes(width: int, height: int, texels: int, suffix: str = ".exr") -> int:
    """What the process holds at most while it renders a surface of such textures, and writes the picture.

    Renderers trace a bounded number of samples at a time, so samples take time alone. Measured as the peak of processes
    that render 64 to 4,096 pixels a side, with each of the three renderers.
    """
    pixel = _FLOAT_PIXEL if suffix.lower() == ".exr" else _BYTE_PIXEL
    return surface_bytes(texels) + pixel * width * height


def require_picture(width: int, height: int, texels: int, suffix: str = ".exr") -> int:
    """The bytes of `picture_bytes`, if they may be taken.

    Raises:
        ConfigError: more are needed than are allowed; it says which picture of this shape would fit.
    """

    def needed(rows: int) -> int:
        return picture_bytes(max(1, rows * width // height), rows, texels, suffix)

    def fitting(allowed: int) -> str | None:
        rows = most_that_fits(needed, height, allowed)
        return None if rows is None else f"{max(1, rows * width // height)} x {rows} pixels"

    return require_memory(f"a picture of {width} x {height} pixels needs", needed(height), fitting)
