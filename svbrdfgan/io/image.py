"""Image and texture files. Values are linear in memory; PNG and JPEG store 8-bit sRGB, EXR and HDR linear floats.

EXR values are read and written unchanged: rendered images are premultiplied by coverage, layers have straight alpha.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
import torch
from jaxtyping import Float, Int, UInt8
from numpy import ndarray
from torch import Tensor

from svbrdfgan.errors import AssetError
from svbrdfgan.io.atomic import atomic_path
from svbrdfgan.io.eight_bit import MOST_LINEAR, require_bytes
from svbrdfgan.io.exr import read_floats, write_floats
from svbrdfgan.io.files import check_file

if TYPE_CHECKING:
    from PIL.Image import Image

log = logging.getLogger(__name__)

EIGHT_BIT = (".png", ".jpg", ".jpeg")
FLOAT = (".exr", ".hdr")
LUMINANCE = ("Y",)  # EXR's names of channels
COLOR = ("R", "G", "B", "A")

_STRIP = 1 << 20  # pixels at a time, about

Encoding = Literal["srgb", "raw"]
"""How 8-bit files store values: colours as sRGB, and numbers that are no colours as they are."""


def linear_from_srgb(values: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
    """Decodes sRGB values in [0, 1] to linear ones, by the piecewise function of IEC 61966-2-1."""
    return torch.where(values <= 0.04045, values / 12.92, ((values.clamp(min=0.04045) + 0.055) / 1.055) ** 2.4)


def srgb_from_linear(values: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
    """Encodes linear values as sRGB: the inverse of `linear_from_srgb`."""
    # Clamped, since the slope at 0 is infinite, of which `where` would make a gradient of NaN.
    curve = 1.055 * values.clamp(min=0.0031308) ** (1 / 2.4) - 0.055
    return torch.where(values <= 0.0031308, values * 12.92, curve)


def luminance(image: Float[Tensor, "*shape 3"]) -> Float[Tensor, "*shape"]:
    """Relative luminance of linear RGB with the sRGB primaries (ITU-R BT.709)."""
    return image @ image.new_tensor([0.2126, 0.7152, 0.0722])


def load_image(path: str | os.PathLike[str]) -> Float[Tensor, "height width channels"]:
    """The image in a PNG, JPEG, EXR or HDR file as linear RGB or RGBA, row 0 on top. Grey becomes RGB.

    Raises:
        AssetError: the file is not of the kind that its suffix says, or an EXR has neither R, G, B nor Y channels.
    """
    path = check_file(path, EIGHT_BIT + FLOAT, "picture")
    return _load_float(path) if path.suffix.lower() in FLOAT else _load_eight_bit(path)


def load_grey(path: str | os.PathLike[str]) -> Float[Tensor, "height width"]:
    """The numbers in [0, 1] that a picture stores, for what is not sRGB: the mean of its colours, times its alpha.

    Raises:
        AssetError: as for `load_image`.
    """
    path = check_file(path, EIGHT_BIT + FLOAT, "picture")
    grey = _grey(_load_float(path)) if path.suffix.lower() in FLOAT else _load_eight_bit(path, _grey_from_picture)
    return grey.nan_to_num(nan=0.0).clamp(0, 1)


def save_image(
    path: str | os.PathLike[str], image: Float[Tensor, "height width channels"], encoding: Encoding = "srgb"
) -> None:
    """Writes 1, 3 or 4 linear channels, row 0 on top. PNG and JPEG clip to [0, 1]; alpha is never sRGB-encoded.

    Args:
        encoding: of PNG and JPEG. EXR and HDR keep values as they are.

    Raises:
        AssetError: the suffix or the shape is not supported, the format has no alpha, or the file cannot be written.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if image.ndim != 3 or image.shape[2] not in (1, 3, 4) or image.numel() == 0:
        raise AssetError(
            f"{path}: an image of shape {tuple(image.shape)} cannot be saved; wanted (height, width, 1 | 3 | 4)."
        )
    if suffix not in EIGHT_BIT + FLOAT:
        raise AssetError(
            f"{path} is not a kind of picture that can be written; use one of {', '.join(EIGHT_BIT + FLOAT)}."
        )
    if image.shape[2] == 4 and suffix not in (".png", ".exr"):
        raise AssetError(f"{path}: {suffix} files hold no alpha; use .png or .exr.")
    if suffix in FLOAT:
        names = LUMINANCE if image.shape[2] == 1 else COLOR[: image.shape[2]]
        write_floats(path, names, image.detach().cpu().float().numpy())
    else:
        with atomic_path(path) as temporary:
            picture(image, encoding).save(temporary, quality=95)


def save_codes(path: str | os.PathLike[str], codes: Int[Tensor, "height width"], bits: Literal[8, 16]) -> None:
    """Writes whole numbers, which fit into this number of bits, as they are into a grey PNG; row 0 on top.

    Raises:
        AssetError: the file cannot be written.
    """
    from PIL import Image as PillowImage

    values = codes.cpu().numpy().astype(np.uint8 if bits == 8 else np.uint16)
    with atomic_path(path) as temporary:
        PillowImage.fromarray(values).save(temporary)


def save_texture(
    path: str | os.PathLike[str], texture: Float[Tensor, "rows cols channels"], encoding: Encoding = "srgb"
) -> None:
    """The same as `save_image`, but row 0 is at v = 0, the bottom of the image."""
    save_image(path, texture.flip(0), encoding)


def texture_png(texture: Float[Tensor, "rows cols channels"], encoding: Encoding = "srgb") -> bytes:
    """The bytes of the PNG file that `save_texture` would write."""
    stream = BytesIO()
    picture(texture.flip(0), encoding).save(stream, format="PNG")
    return stream.getvalue()


def picture(image: Float[Tensor, "height width channels"], encoding: Encoding = "srgb") -> Image:
    """An 8-bit Pillow image of 1, 3 or 4 channels, clipped to [0, 1]; `encoding` is that of all but alpha."""
    from PIL import Image as PillowImage

    values = image.detach().cpu().float()
    if not torch.isfinite(values).all():
        log.warning("a picture holds values that are not finite; they are written as 0 or 1")
        values = values.nan_to_num(nan=0.0)
    values = values.clamp(0, 1)
    if encoding == "srgb":
        values = torch.cat([srgb_from_linear(values[..., :3]), values[..., 3:]], dim=-1)
    codes = (values * 255).round().byte().numpy()
    return PillowImage.fromarray(codes[..., 0] if codes.shape[-1] == 1 else codes)


def linear_from_picture(image: Image) -> Float[Tensor, "height width channels"]:
    """Linear RGB of a Pillow image, or RGBA if it has transparency; row 0 on top.

    Raises:
        OSError, SyntaxError, ValueError: the image's file is broken (Pillow decodes lazily).
    """
    linear = np.empty(_shape(image), np.float32)
    for rows, part in _strips(image):
        if image.mode.startswith("I"):
            linear[rows] = linear_from_srgb(torch.from_numpy(_sixteen_bits(part))).numpy()
            continue
        codes = _eight_bits(part)
        np.take(_LINEAR, codes[..., :3], out=linear[rows, :, :3], mode="clip")
        np.divide(codes[..., 3:], np.float32(255.0), out=linear[rows, :, 3:])
    return torch.from_numpy(linear)


def numbers_from_picture(image: Image) -> Float[Tensor, "height width channels"]:
    """The numbers in [0, 1] that a Pillow image stores, RGB or RGBA, for what is not sRGB; row 0 on top.

    Raises:
        OSError, SyntaxError, ValueError: the image's file is broken (Pillow decodes lazily).
    """
    numbers = np.empty(_shape(image), np.float32)
    for rows, part in _strips(image):
        if image.mode.startswith("I"):
            numbers[rows] = _sixteen_bits(part)
        else:
            np.divide(_eight_bits(part), np.float32(255.0), out=numbers[rows])
    return torch.from_numpy(numbers)


def _grey_from_picture(image: Image) -> Float[Tensor, "height width"]:
    """`_grey` of what the image stores, in as little memory as it takes."""
    grey = np.empty((image.height, image.width), np.float32)
    for rows, part in _strips(image):
        grey[rows] = _grey(numbers_from_picture(part)).numpy()
    return torch.from_numpy(grey)


def _grey(values: Float[Tensor, "height width channels"]) -> Float[Tensor, "height width"]:
    return values[..., :3].mean(dim=-1) * values[..., 3:].prod(dim=-1)


def _strips(image: Image) -> Iterator[tuple[slice, Image]]:
    """Some rows of the picture after others, so that it is in memory in bytes and in what they become, and no more."""
    height = max(1, _STRIP // image.width)
    for top in range(0, image.height, height):
        rows = slice(top, min(top + height, image.height))
        yield rows, image.crop((0, rows.start, image.width, rows.stop))


def _shape(image: Image) -> tuple[int, int, int]:
    return image.height, image.width, 4 if _has_alpha(image) else 3


def _has_alpha(image: Image) -> bool:
    return not image.mode.startswith("I") and ("A" in image.getbands() or "transparency" in image.info)


def _sixteen_bits(image: Image) -> Float[ndarray, "height width 1"]:
    """Grey in [0, 1], which Pillow's convert("RGB") would clip to 8 bits."""
    return np.clip(np.asarray(image).astype(np.float32) / 65535.0, 0.0, 1.0)[..., None]


def _eight_bits(image: Image) -> UInt8[ndarray, "height width channels"]:
    return np.asarray(image.convert("RGBA" if _has_alpha(image) else "RGB"))


_LINEAR: Float[ndarray, " codes"] = linear_from_srgb(torch.arange(256, dtype=torch.float32) / 255.0).numpy()


def _load_eight_bit(
    path: Path, decode: Callable[[Image], Float[Tensor, "height width ..."]] = linear_from_picture
) -> Float[Tensor, "height width ..."]:
    from PIL import Image as PillowImage

    try:
        with PillowImage.open(path) as image:
            if image.width * image.height > MOST_LINEAR:
                raise ValueError(
                    f"it has {image.width} x {image.height} pixels; at most {MOST_LINEAR // 10**6} million are kept "
                    "as linear values"
                )
            require_bytes(image, path.stat().st_size)
            return decode(image)
    except Exception as error:  # Pillow's decoders raise many types; each means a broken file
        raise AssetError(f"{path} cannot be read as a picture: {error}.") from error


def _load_float(path: Path) -> Float[Tensor, "height width channels"]:
    names, values = read_floats(path)
    wanted: tuple[str, ...] = COLOR if set(COLOR) <= set(names) else COLOR[:3]
    if not set(wanted) <= set(names):
        if len(names) > 1 and "Y" not in names:
            raise AssetError(
                f"{path} has channels {', '.join(names)}; wanted R, G, B or Y. Use load_exr to read others."
            )
        wanted = ("Y",) * 3 if "Y" in names else names * 3
    return torch.from_numpy(values[..., [names.index(name) for name in wanted]])
