"""Paper, ink, type and cells of sheets of pictures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from svbrdfgan.report.pictures import Picture, to_pillow

if TYPE_CHECKING:
    from PIL.Image import Image
    from PIL.ImageFont import FreeTypeFont

PAPER, WELL, INK = (255, 255, 255), (238, 238, 240), (60, 60, 66)


def cell(picture: Picture, width: int, height: int) -> Image:
    """The picture in a well of so many pixels, as large as fits."""
    from PIL import Image as PillowImage
    from PIL import ImageOps

    image = ImageOps.contain(to_pillow(picture), (width, height), PillowImage.Resampling.LANCZOS)
    well = PillowImage.new("RGB", (width, height), WELL)
    place = ((width - image.width) // 2, (height - image.height) // 2)
    well.paste(image, place, image.getchannel("A") if image.mode == "RGBA" else None)
    return well


def font(size: int) -> FreeTypeFont:
    """The sans-serif that matplotlib ships, since Pillow's own is not always scalable; of a size in pixels."""
    import matplotlib
    from PIL import ImageFont

    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"), size)
