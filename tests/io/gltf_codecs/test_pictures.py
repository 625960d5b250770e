"""Pictures of the formats that glTF allows, and clear words about those that cannot be decoded."""

import struct
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from svbrdfgan.io.gltf_codecs.pictures import KTX2, UnreadablePicture, decode_picture

PIXELS = np.random.default_rng(0).integers(0, 256, (3, 5, 4), dtype=np.uint8)


def ktx2(level: bytes, format_: int = 43, scheme: int = 0, faces: int = 1, width: int = 5, height: int = 3) -> bytes:
    head = KTX2 + struct.pack("<9I", format_, 1, width, height, 0, 0, faces, 1, scheme) + bytes(32)
    return head + struct.pack("<3Q", 104, len(level), PIXELS.nbytes) + level


@pytest.mark.parametrize("format_", ["PNG", "WEBP", "JPEG"])
def test_pictures_of_pillow(format_: str) -> None:
    file = BytesIO()
    Image.fromarray(PIXELS[..., :3]).save(file, format_, lossless=True)
    picture = decode_picture(file.getvalue(), None)
    assert picture.size == (5, 3)
    if format_ != "JPEG":
        np.testing.assert_array_equal(np.asarray(picture), PIXELS[..., :3])


def test_ktx2_of_plain_pixels() -> None:
    np.testing.assert_array_equal(np.asarray(decode_picture(ktx2(PIXELS.tobytes()), "image/ktx2")), PIXELS)


def test_ktx2_packed_by_zstandard() -> None:
    zstandard = pytest.importorskip("zstandard")
    packed = zstandard.compress(PIXELS.tobytes())
    np.testing.assert_array_equal(np.asarray(decode_picture(ktx2(packed, scheme=2), None)), PIXELS)
    with pytest.raises(UnreadablePicture, match=" 0 bytes"):
        decode_picture(ktx2(zstandard.compress(bytes(10**7)), scheme=2), None)
    with pytest.raises(UnreadablePicture, match="broken"):
        decode_picture(ktx2(b"abcdefghijkl", scheme=2), None)


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "cannot be read"),
        (b"\x89PNG\r\n\x1a\n" + bytes(30), "cannot be read"),
        (KTX2, "cut short"),
        (ktx2(b"", format_=0, scheme=1), "Basis Universal"),
        (ktx2(b"", format_=0, scheme=2), "Basis Universal"),
        (ktx2(b"", format_=145), "format 145"),
        (ktx2(b"abc"), "3 bytes; wanted 60"),
        (ktx2(PIXELS.tobytes(), faces=6), "flat"),
        (ktx2(b"packed", scheme=2, width=2**16, height=2**16), "65536 x 65536 texels; wanted at most 100 million"),
    ],
)
def test_what_cannot_be_decoded_is_said(data: bytes, reason: str) -> None:
    with pytest.raises(UnreadablePicture, match=reason):
        decode_picture(data, "image/png")
