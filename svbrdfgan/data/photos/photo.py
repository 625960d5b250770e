"""Loads users' pictures and masks as linear values."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.errors import AssetError
from svbrdfgan.io.eight_bit import eight_bit, require_bytes
from svbrdfgan.io.files import check_file
from svbrdfgan.io.image import EIGHT_BIT, linear_from_picture, load_image, srgb_from_linear

if TYPE_CHECKING:
    from PIL.Image import Image

SUFFIXES = (*EIGHT_BIT, ".exr")
MOST_PIXELS = 300_000_000
"""Of a file that is read; phones take 200 million."""
_KEPT_PIXELS = 25_000_000
ORIENTATION, _FIRST_TURNED = 0x0112, 5
"""EXIF's tag, and its first value of a picture that lies on its side."""
_LEAST = 16


@dataclass(frozen=True, eq=False)
class Photo:
    """A picture as the user took it, upright.

    Attributes:
        image: linear RGB, not premultiplied.
        mask: share of each pixel that shows the object; None if there is no mask.
    """

    image: Float[Tensor, "height width 3"]
    mask: Float[Tensor, "height width"] | None

    @property
    def size(self) -> tuple[int, int]:
        """Width and height."""
        return self.image.shape[1], self.image.shape[0]


def load_photo(path: Path, mask: Path | None) -> Photo:
    """The picture from a PNG or JPEG (sRGB) or an EXR (linear), turned upright by its EXIF orientation.

    The mask is the given file, white where the object is; without one, the picture's alpha channel if it has any.

    Raises:
        AssetError: a file cannot be read, is too small or has values that are not finite, or the mask does not fit.
    """
    image = _load(path, _LEAST)
    if not torch.isfinite(image).all():
        raise AssetError(f"{path} holds values that are not finite; export it again.")
    height, width = image.shape[:2]
    color, alpha = image[..., :3].clamp(min=0), image[..., 3:].clamp(0, 1)
    if alpha.numel() and path.suffix.lower() == ".exr":
        color = color / alpha.clamp(min=1e-6)  # EXR is premultiplied
    if mask is not None:
        return Photo(color, _load_mask(mask, path, (width, height)))
    own = alpha[..., 0] if alpha.numel() and bool((alpha < 1).any()) else None
    return Photo(color, _require_object(own, path))


def find_photo(path: Path) -> Path:
    """The picture of this path, which may lack its suffix; the path itself if there is none."""
    found = (path.with_name(path.name + suffix) for suffix in ("", *SUFFIXES))
    return next((file for file in found if file.is_file()), path)


def find_mask(folder: Path, name: str) -> Path:
    """The mask of the picture of this name, with or without its folders, the suffix replaced or followed by `.png`.

    Raises:
        AssetError: there is none.
    """
    choices = [*_mask_names(folder / name), *_mask_names(folder / Path(name).name)]
    for path in choices:
        if path.is_file():
            return path
    raise AssetError(f"{choices[0]} does not exist; wanted a mask of each picture, or no 'masks'.")


def photo_size(path: Path) -> tuple[int, int]:
    """Width and height of the upright picture in a file, which `load_photo` may reduce.

    Raises:
        AssetError: the file cannot be read.
    """
    check_file(path, SUFFIXES, "picture")
    if path.suffix.lower() == ".exr":
        height, width = load_image(path).shape[:2]
        return width, height
    with opened(path) as image:
        turned = image.getexif().get(ORIENTATION, 1) >= _FIRST_TURNED
        return (image.height, image.width) if turned else image.size


def _mask_names(path: Path) -> Iterator[Path]:
    yield path.with_suffix(".png")
    yield path.with_name(f"{path.name}.png")
    yield path


def _load_mask(path: Path, picture: Path, size: tuple[int, int]) -> Float[Tensor, "height width"]:
    values = _load(path)
    found = (values.shape[1], values.shape[0])
    if found != size:
        raise AssetError(
            f"{path} is {found[0]} x {found[1]} pixels and its picture {picture.name} {size[0]} x {size[1]}: "
            "a mask must have its picture's size."
        )
    if values.shape[2] == 4:
        shown = values[..., 3]
    else:  # 8-bit masks hold shares, not sRGB: what decoding did is undone
        shown = values.mean(dim=-1) if path.suffix.lower() == ".exr" else srgb_from_linear(values).mean(dim=-1)
    mask = _require_object(shown.clamp(0, 1), path)
    assert mask is not None
    return mask


def _require_object(mask: Float[Tensor, "height width"] | None, path: Path) -> Float[Tensor, "height width"] | None:
    if mask is not None and not bool((mask > 0.5).any()):
        raise AssetError(f"{path} masks everything away: no pixel is white (or opaque), so that no object is left.")
    return mask


def _load(path: Path, least: int = 1) -> Float[Tensor, "height width channels"]:
    """The picture in a file, if it has so many pixels each way."""
    check_file(path, SUFFIXES, "picture")
    if path.suffix.lower() == ".exr":
        values = load_image(path)
        _require_size(path, values.shape[1], values.shape[0], least)
        return values
    from PIL import ImageOps

    with opened(path) as image:
        smaller = reduced(image)
        _require_size(path, *smaller.size, least)
        return linear_from_picture(ImageOps.exif_transpose(smaller))


def _require_size(path: Path, width: int, height: int, least: int) -> None:
    if min(width, height) < least:
        raise AssetError(f"{path} is {width} x {height} pixels; wanted at least {least} x {least}.")


@contextmanager
def opened(path: Path) -> Iterator[Image]:
    """A picture that Pillow reads.

    Raises:
        AssetError: it has too many pixels, or an error of Pillow in the block, which means that it is broken.
    """
    from PIL import Image

    usual = Image.MAX_IMAGE_PIXELS
    Image.MAX_IMAGE_PIXELS = None  # Pillow's own limit is below what phones take
    try:
        with Image.open(path) as image:
            if image.width * image.height > MOST_PIXELS:
                raise AssetError(
                    f"{path} has {image.width * image.height / 1e6:.0f} megapixels; at most {MOST_PIXELS / 1e6:.0f} "
                    "are read: make it smaller."
                )
            require_bytes(image, path.stat().st_size)
            yield image
    except AssetError:
        raise
    except Exception as error:  # Pillow's decoders raise many types
        raise AssetError(f"{path} cannot be read as a picture: {error}.") from error
    finally:
        Image.MAX_IMAGE_PIXELS = usual


def reduced(image: Image) -> Image:
    """The picture, or means over squares of its pixels if they are too many to be kept as linear values."""
    factor = math.ceil(math.sqrt(image.width * image.height / _KEPT_PIXELS))
    if factor < 2:
        return image
    # bytes of a palette have no mean; others have, and are fewer before grey becomes RGB
    plain = image.mode in ("L", "LA", "RGB", "RGBA") and "transparency" not in image.info
    smaller = eight_bit(image.reduce(factor)) if plain else eight_bit(image).reduce(factor)
    smaller.getexif().update(image.getexif())  # which says how the camera was held
    return smaller
