"""How much memory a picture takes while it is rendered and written."""

from __future__ import annotations

from svbrdfgan.utils.memory import PROGRAM, most_that_fits, require_memory

_RENDERER = 130 << 20  # bytes of a renderer's libraries and kernels, and of the samples that it traces at a time
_FLOAT_PIXEL = 52  # bytes of a pixel as radiance and coverage, and of their copies while an EXR file is written
_BYTE_PIXEL = 104  # bytes of a pixel that also becomes sRGB, of PNG and JPEG files


def picture_bytes(width: int, height: int, suffix: str = ".exr") -> int:
    """What the process holds at most while it renders a picture, besides the scene, and writes it to such a file.

    Renderers trace a bounded number of samples at a time, so samples take time alone. Measured as the peak of processes
    that render 1,024 to 4,096 pixels a side, with each of the three renderers.
    """
    pixel = _FLOAT_PIXEL if suffix.lower() == ".exr" else _BYTE_PIXEL
    return PROGRAM + _RENDERER + pixel * width * height


def require_picture(width: int, height: int, suffix: str = ".exr", further: int = 0) -> int:
    """The bytes of `picture_bytes` and of the scene, if they may be taken.

    Args:
        further: bytes of the scene.

    Raises:
        ConfigError: more are needed than are allowed; it says which picture of this shape would fit.
    """

    def needed(rows: int) -> int:
        return further + picture_bytes(max(1, rows * width // height), rows, suffix)

    def fitting(allowed: int) -> str | None:
        rows = most_that_fits(needed, height, allowed)
        return None if rows is None else f"{max(1, rows * width // height)} x {rows} pixels"

    return require_memory(f"a picture of {width} x {height} pixels needs", needed(height), fitting)
