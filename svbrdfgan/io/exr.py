"""Float images with named channels (EXR, HDR), through OpenImageIO."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray
from torch import Tensor

from svbrdfgan.errors import AssetError
from svbrdfgan.io.atomic import atomic_path
from svbrdfgan.io.files import check_file
from svbrdfgan.utils.memory import require_memory

MAX_PIXELS = 2**28
"""A header that claims more RGBA pixels than this is rejected as broken before memory is allocated."""
_NUMBER = 14
"""Bytes of a number while a picture is read, its channels are picked and, of an environment, checked. Measured as the
peak of a process that loads an environment of 6,000 x 3,000 pixels."""


def load_exr(path: str | os.PathLike[str], *, uv_map: bool = False) -> dict[str, Float[Tensor, "rows cols"]]:
    """The channels of an EXR file by name. Row 0 is the top, or v = 0 if `uv_map` is set.

    Raises:
        AssetError: the file cannot be read as EXR.
    """
    names, values = read_floats(check_file(path, (".exr",), "picture"))
    planes = torch.from_numpy(values[::-1].copy() if uv_map else values)
    return {name: planes[..., channel].contiguous() for channel, name in enumerate(names)}


def save_exr(
    path: str | os.PathLike[str],
    channels: Mapping[str, Float[Tensor, "rows cols"]],
    *,
    half: bool = False,
    uv_map: bool = False,
) -> None:
    """Writes channels by name, such as "position.X". Row 0 is the top, or v = 0 if `uv_map` is set.

    Args:
        half: write 16-bit floats instead of 32-bit floats.

    Raises:
        AssetError: there are no channels, their shapes differ, the suffix is not .exr, or the file cannot be written.
    """
    shapes = {tuple(plane.shape) for plane in channels.values()}
    if len(shapes) != 1 or len(next(iter(shapes))) != 2:
        raise AssetError(f"{path}: channels of shapes {sorted(shapes)} cannot be saved; wanted one shape (rows, cols).")
    if Path(path).suffix.lower() != ".exr":
        raise AssetError(f"{path} cannot hold named channels; use .exr.")
    values = torch.stack([plane.detach().cpu().float() for plane in channels.values()], dim=-1).numpy()
    write_floats(Path(path), tuple(channels), values[::-1] if uv_map else values, half=half)


def read_floats(path: Path) -> tuple[tuple[str, ...], Float[ndarray, "height width channels"]]:
    """Channel names and values of the first image in a file, row 0 on top.

    Raises:
        AssetError: the file is broken, or has more pixels than the memory holds that may be taken.
    """
    import OpenImageIO as oiio  # noqa: N813

    source = oiio.ImageInput.open(str(path))
    if source is None:
        raise AssetError(f"{path} cannot be read as a picture: {_sentence(_message(oiio.geterror), path)}.")
    spec = source.spec()
    if spec.width * spec.height * spec.nchannels > 4 * MAX_PIXELS:
        source.close()
        raise AssetError(f"{path} claims {spec.width} x {spec.height} pixels, which is beyond use; export it again.")
    require_memory(
        f"{path} has {spec.width} x {spec.height} pixels of {spec.nchannels} channels, which need",
        _NUMBER * spec.width * spec.height * spec.nchannels,
        instead="make it smaller",
        error=AssetError,
    )
    values = source.read_image("float")
    reason = _message(source.geterror)
    source.close()
    if values is None:
        raise AssetError(f"{path} is damaged or cut short: {_sentence(reason, path)}.")
    return tuple(spec.channelnames), np.asarray(values, dtype=np.float32).reshape(spec.height, spec.width, -1)


def write_floats(
    path: Path, names: tuple[str, ...], values: Float[ndarray, "height width channels"], *, half: bool = False
) -> None:
    """Writes an EXR or HDR file atomically; row 0 is the top.

    Raises:
        AssetError: the file cannot be written.
    """
    import OpenImageIO as oiio  # noqa: N813

    height, width, channels = values.shape
    spec = oiio.ImageSpec(width, height, channels, "half" if half else "float")
    spec.channelnames = names
    spec.attribute("compression", "zip")
    # The default is the current time; with a fixed time, equal images give equal files.
    spec.attribute("DateTime", "1970:01:01 00:00:00")
    with atomic_path(path) as temporary:
        target = oiio.ImageOutput.create(str(temporary))
        if target is None:
            raise OSError(_sentence(_message(oiio.geterror), path))
        done = target.open(str(temporary), spec) and target.write_image(np.ascontiguousarray(values, dtype=np.float32))
        if not (target.close() and done):
            raise OSError(_sentence(_message(target.geterror) or _message(oiio.geterror), path))
        if not _ends(temporary, height):  # the library may say nothing when the disk is full
            raise OSError("it was cut off")


def _ends(path: Path, height: int) -> bool:
    """Whether the file has its last row."""
    import OpenImageIO as oiio  # noqa: N813

    source = oiio.ImageInput.open(str(path))
    last = None if source is None else source.read_scanline(height - 1, 0, "float")
    if source is not None:
        source.close()  # else Windows would not rename it
    _message(oiio.geterror)  # else a later message begins with it
    return last is not None


def _message(error: Callable[[], str]) -> str:
    """The library's message, which quotes the file: it need not be text."""
    try:
        return error()
    except UnicodeDecodeError:
        return "its header is no text"


def _sentence(message: str, path: Path) -> str:
    """OpenImageIO's error message on one line, with the file's name instead of its full path."""
    line = " ".join(message.replace(str(path), path.name).split())
    return line.rstrip(".") or "no reason was given"
