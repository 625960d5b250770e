"""Display-referred pictures for reports and sheets: sRGB in [0, 1], three channels or four, row 0 on top."""

from __future__ import annotations

import base64
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from svbrdfgan.io.image import srgb_from_linear
from svbrdfgan.rendering.compositing import composite
from svbrdfgan.types import Layer

if TYPE_CHECKING:
    from PIL.Image import Image
    from PIL.ImageFont import FreeTypeFont

Picture = Float[Tensor, "height width channels"]
# Colours of sheets of pictures.
PAPER = (255, 255, 255)
WELL = (238, 238, 240)  # behind a picture in its cell
INK = (60, 60, 66)

# The checker behind layers.
_CHECKS = 16  # along a side
_DARK = 0.20  # linear grey
_LIGHT = 0.32


def to_pillow(picture: Picture, least: int = 256) -> Image:
    """The picture in 8 bits; one narrower than `least` pixels is enlarged by a whole factor (Lanczos)."""
    from PIL import Image as PillowImage

    values = picture.detach().cpu().float().nan_to_num().clamp(0, 1)
    image = PillowImage.fromarray((values * 255).round().byte().numpy())
    factor = -(-least // image.width)
    if factor == 1:
        return image
    return image.resize((image.width * factor, image.height * factor), PillowImage.Resampling.LANCZOS)


def data_uri(picture: Picture, least: int = 256) -> str:
    """The picture as a data URI of a PNG."""
    stream = BytesIO()
    to_pillow(picture, least).save(stream, format="PNG", optimize=True)
    return "data:image/png;base64," + base64.b64encode(stream.getvalue()).decode("ascii")


def upright(texture: Float[Tensor, "rows cols 3"], shown: Bool[Tensor, "rows cols"]) -> Picture:
    """A texture's display values as a picture with v upwards, transparent where `shown` is false."""
    return torch.cat([texture, shown.unsqueeze(-1).float()], dim=-1).flip(0)


def framed(picture: Picture, coverage: Float[Tensor, "height width"], aspect: float = 1.5) -> Picture:
    """The part of a picture that shows the surface, with a margin, as wide as `aspect` times its height.

    Beyond the picture, that part has the colour of the picture's upper left corner.
    """
    used = coverage.cpu() > 0.05
    if not used.any():
        return picture
    rows, cols = torch.nonzero(used.any(dim=1)).flatten(), torch.nonzero(used.any(dim=0)).flatten()
    (top, bottom), (left, right) = ((int(span[0]), int(span[-1]) + 1) for span in (rows, cols))
    height = round(1.15 * max(bottom - top, (right - left) / aspect))
    width = round(aspect * height)
    canvas = picture[0, 0].expand(picture.shape[0] + 2 * height, picture.shape[1] + 2 * width, -1).clone()
    canvas[height:-height, width:-width] = picture
    first_row, first_col = (top + bottom + height) // 2, (left + right + width) // 2
    return canvas[first_row : first_row + height, first_col : first_col + width]


def signed_as_color(values: Float[Tensor, "3 rows cols"]) -> Float[Tensor, "rows cols 3"]:
    """Coordinates or directions in [-1, 1] as colours: x red, y green, z blue, zero mid grey."""
    return (values * 0.5 + 0.5).clamp(0, 1).permute(1, 2, 0)


def over_checker(layer: Layer) -> Float[Tensor, "rows cols 3"]:
    """The base colour of a layer over a grey checker."""
    rows, cols = layer.alpha.shape
    row = torch.arange(rows) * _CHECKS // rows
    col = torch.arange(cols) * _CHECKS // cols
    odd = ((row[:, None] + col[None, :]) % 2).float()
    checker = (_DARK + (_LIGHT - _DARK) * odd).unsqueeze(-1).expand(rows, cols, 3)
    return srgb_from_linear(composite(checker, layer).clamp(0, 1))


def heat(values: Float[Tensor, "rows cols"], top: float) -> Float[Tensor, "rows cols 3"]:
    """Values from 0 to `top` in matplotlib's colour map "magma"."""
    import matplotlib

    return torch.from_numpy(matplotlib.colormaps["magma"]((values / top).clamp(0, 1).numpy())[..., :3]).float()


def cell(picture: Picture, width: int, height: int) -> Image:
    """The picture centred in a cell of `width` x `height` pixels, as large as fits."""
    from PIL import Image as PillowImage
    from PIL import ImageOps

    image = ImageOps.contain(to_pillow(picture), (width, height), PillowImage.Resampling.LANCZOS)
    well = PillowImage.new("RGB", (width, height), WELL)
    place = ((width - image.width) // 2, (height - image.height) // 2)
    well.paste(image, place, image.getchannel("A") if image.mode == "RGBA" else None)
    return well


def font(size: int) -> FreeTypeFont:
    """matplotlib's sans-serif font, since Pillow's own is not always scalable; the size is in pixels."""
    import matplotlib
    from PIL import ImageFont

    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"), size)
