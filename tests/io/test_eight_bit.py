"""Pictures of all modes that glTF files hold come through as bytes."""

from __future__ import annotations

from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from svbrdfgan.io.eight_bit import flipped_bytes, resized_bytes
from svbrdfgan.io.gltf_codecs.pictures import decode_picture


def stored(picture: Image.Image, kind: str = "PNG", **keys: object) -> Image.Image:
    """The picture as a file of this kind is read."""
    stream = BytesIO()
    picture.save(stream, format=kind, **keys)
    return decode_picture(stream.getvalue(), None)


def test_row_0_is_the_bottom() -> None:
    picture = Image.fromarray(np.array([[[1, 2, 3]], [[4, 5, 6]]], np.uint8))
    assert flipped_bytes(stored(picture)).tolist() == [[[4, 5, 6]], [[1, 2, 3]]]


def test_grey_of_16_bits_is_rounded() -> None:
    values = np.array([[0, 129, 32896, 65535]], np.uint16)
    assert flipped_bytes(stored(Image.fromarray(values)))[0].tolist() == [[v] * 3 for v in (0, 1, 128, 255)]


def test_palettes_with_and_without_transparency() -> None:
    palette = Image.new("P", (2, 1))
    palette.putpalette([10, 20, 30, 40, 50, 60])
    palette.putdata([0, 1])
    assert flipped_bytes(stored(palette))[0].tolist() == [[10, 20, 30], [40, 50, 60]]
    clear = flipped_bytes(stored(palette, transparency=bytes([255, 7])))
    assert clear[0].tolist() == [[10, 20, 30, 255], [40, 50, 60, 7]]


def test_grey_with_alpha_and_black_and_white() -> None:
    assert flipped_bytes(stored(Image.new("LA", (1, 1), (9, 8)))).tolist() == [[[9, 9, 9, 8]]]
    assert flipped_bytes(stored(Image.new("1", (1, 1), 1))).tolist() == [[[255] * 3]]


def test_a_color_that_is_transparent() -> None:
    picture = Image.fromarray(np.array([[[1, 2, 3], [4, 5, 6]]], np.uint8))
    assert flipped_bytes(stored(picture, transparency=(4, 5, 6)))[0].tolist() == [[1, 2, 3, 255], [4, 5, 6, 0]]


@pytest.mark.parametrize(("ink", "color"), [((0, 0, 0, 0), 255), ((0, 0, 0, 255), 0), ((0, 0, 0, 128), 127)])
def test_jpegs_of_four_inks(ink: tuple[int, ...], color: int) -> None:
    found = flipped_bytes(stored(Image.new("CMYK", (8, 8), ink), "JPEG"))
    assert found.shape == (8, 8, 3)
    assert np.abs(found.astype(int) - color).max() <= 2


def test_a_resized_picture_has_its_channels_apart() -> None:
    pixels = np.full((4, 4, 4), 200, np.uint8)
    pixels[:, :2, 3] = 0
    larger, smaller = (resized_bytes(Image.fromarray(pixels), size, size) for size in (8, 2))
    assert (larger[..., :3] == 200).all()
    assert larger[0, :, 3].tolist() == [0, 0, 0, 50, 150, 200, 200, 200]
    assert smaller[0].tolist() == [[200, 200, 200, 0], [200, 200, 200, 200]]
