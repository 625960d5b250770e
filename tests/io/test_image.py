"""Pictures: the transfer function, the row order, and what each format keeps."""

import os
import struct
import subprocess
import sys
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
import torch
from PIL import Image

from svbrdfgan.errors import AssetError
from svbrdfgan.io.exr import load_exr, save_exr
from svbrdfgan.io.gltf_codecs.pictures import UnreadablePicture, decode_picture
from svbrdfgan.io.image import (
    linear_from_srgb,
    load_grey,
    load_image,
    save_codes,
    save_image,
    save_texture,
    srgb_from_linear,
)
from svbrdfgan.utils.memory import limited


def test_the_transfer_function_has_its_known_values() -> None:
    srgb = torch.tensor([0.0, 0.04045, 0.5, 1.0], dtype=torch.float64)
    linear = torch.tensor([0.0, 0.04045 / 12.92, 0.21404114048, 1.0], dtype=torch.float64)
    torch.testing.assert_close(linear_from_srgb(srgb), linear, atol=1e-10, rtol=0)
    torch.testing.assert_close(srgb_from_linear(linear), srgb, atol=1e-7, rtol=0)


def test_the_transfer_function_is_inverted_and_differentiable() -> None:
    values = torch.linspace(0, 1, 1001, dtype=torch.float64, requires_grad=True)
    there_and_back = srgb_from_linear(linear_from_srgb(values))
    torch.testing.assert_close(there_and_back, values, atol=1e-6, rtol=0)
    there_and_back.sum().backward()
    assert values.grad is not None
    assert torch.isfinite(values.grad).all()


def test_every_eight_bit_code_survives(tmp_path: Path) -> None:
    codes = np.arange(256, dtype=np.uint8).reshape(16, 16)
    pixels = np.stack([codes, codes.T, 255 - codes, codes[::-1]], axis=-1)
    Image.fromarray(pixels).save(tmp_path / "a.png")
    save_image(tmp_path / "b.png", load_image(tmp_path / "a.png"))
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "b.png")), pixels)


def test_alpha_is_kept_and_not_srgb(tmp_path: Path) -> None:
    save_image(tmp_path / "a.png", torch.full((2, 3, 4), 0.5))
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "a.png"))[0, 0], [188, 188, 188, 128])
    assert load_image(tmp_path / "a.png")[0, 0, 3] == pytest.approx(128 / 255)


def test_numbers_that_are_no_colours_are_written_as_they_are(tmp_path: Path) -> None:
    numbers = torch.tensor([[[-1.0, 0.25, 0.5], [0.75, 1.0, 2.0]]])
    save_image(tmp_path / "a.png", numbers, "raw")
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "a.png")), [[[0, 64, 128], [191, 255, 255]]])


@pytest.mark.parametrize("suffix", [".png", ".exr", ".hdr", ".jpg"])
def test_row_0_of_an_image_is_on_top_and_of_a_texture_at_the_bottom(tmp_path: Path, suffix: str) -> None:
    image = torch.zeros(16, 24, 3)
    image[:8] = 1.0
    save_image(tmp_path / f"image{suffix}", image)
    save_texture(tmp_path / f"texture{suffix}", image)
    torch.testing.assert_close(load_image(tmp_path / f"image{suffix}"), image, atol=0.02, rtol=0)
    torch.testing.assert_close(load_image(tmp_path / f"texture{suffix}").flip(0), image, atol=0.02, rtol=0)
    torch.testing.assert_close(load_image(tmp_path / f"texture{suffix}"), image.flip(0), atol=0.02, rtol=0)
    if suffix in (".png", ".jpg"):
        assert np.asarray(Image.open(tmp_path / f"image{suffix}"))[0, 0, 0] >= 250
        assert np.asarray(Image.open(tmp_path / f"texture{suffix}"))[0, 0, 0] <= 5


@pytest.mark.parametrize("channels", [1, 3, 4])
def test_exr_keeps_floats_exactly(tmp_path: Path, channels: int) -> None:
    image = torch.randn(5, 7, channels, generator=torch.Generator().manual_seed(0)) * 1000
    save_image(tmp_path / "a.exr", image)
    again = load_image(tmp_path / "a.exr")
    assert torch.equal(again, image.expand(-1, -1, max(channels, 3)))


@pytest.mark.parametrize("half", [False, True])
@pytest.mark.parametrize("uv_map", [False, True])
def test_named_channels_come_back_by_name(tmp_path: Path, half: bool, uv_map: bool) -> None:
    generator = torch.Generator().manual_seed(1)
    names = ["position.X", "position.Y", "position.Z", "normal.X", "mask", "R", "part"]
    channels = {name: torch.rand(4, 6, generator=generator) for name in names}
    save_exr(tmp_path / "a.exr", channels, half=half, uv_map=uv_map)
    again = load_exr(tmp_path / "a.exr", uv_map=uv_map)
    assert set(again) == set(channels)
    for name, plane in channels.items():
        torch.testing.assert_close(again[name], plane, atol=1e-3 if half else 0.0, rtol=0)
    on_top = load_exr(tmp_path / "a.exr")["mask"][0]
    torch.testing.assert_close(on_top, channels["mask"][-1 if uv_map else 0], atol=1e-3, rtol=0)


@pytest.mark.parametrize("half", [False, True])
def test_equal_pictures_are_equal_files_whenever_they_are_written(tmp_path: Path, half: bool) -> None:
    channels = {"R": torch.rand(4, 6, generator=torch.Generator().manual_seed(2))}
    save_exr(tmp_path / "a.exr", channels, half=half)
    save_exr(tmp_path / "b.exr", channels, half=half)
    assert (tmp_path / "a.exr").read_bytes() == (tmp_path / "b.exr").read_bytes()
    source = oiio.ImageInput.open(str(tmp_path / "a.exr"))
    assert source.spec().getattribute("DateTime") == "1970:01:01 00:00:00"  # by itself it would be now, in seconds
    source.close()


@pytest.mark.parametrize("mode", ["L", "LA", "P", "RGB", "RGBA", "I;16", "1", "CMYK"])
def test_every_kind_of_picture_becomes_rgb_or_rgba(tmp_path: Path, mode: str) -> None:
    if mode == "I;16":
        picture = Image.fromarray(np.full((4, 5), 65535, dtype=np.uint16))
    else:
        picture = Image.new("RGB", (5, 4), (255, 255, 255)).convert(mode)
    path = tmp_path / ("a.jpg" if mode == "CMYK" else "a.png")
    picture.save(path)
    image = load_image(path)
    assert image.shape == (4, 5, 4 if mode in ("LA", "RGBA") else 3)
    assert image.dtype == torch.float32
    torch.testing.assert_close(image, torch.ones_like(image))


def test_values_beyond_the_range_are_clipped_and_nan_is_a_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    save_image(tmp_path / "a.png", torch.tensor([[[-1.0, 2.0, torch.nan]]]))
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "a.png"))[0, 0], [0, 255, 0])
    assert "not finite" in caplog.text


def test_saving_does_not_touch_the_tensor(tmp_path: Path) -> None:
    image = torch.full((2, 2, 3), 0.25, requires_grad=True)
    save_image(tmp_path / "a.png", image)
    assert torch.equal(image, torch.full((2, 2, 3), 0.25))


@pytest.mark.parametrize("name", ["a.png", "a.jpg", "a.exr", "a.hdr"])
@pytest.mark.parametrize("damage", ["missing", "folder", "empty", "garbage", "cut"])
def test_a_bad_picture_gives_one_sentence_that_names_it(tmp_path: Path, name: str, damage: str) -> None:
    path = tmp_path / name
    if damage == "folder":
        path.mkdir()
    elif damage in ("empty", "garbage"):
        path.write_bytes(b"garbage" * 50 if damage == "garbage" else b"")
    elif damage == "cut":
        save_image(path, torch.rand(32, 32, 3, generator=torch.Generator().manual_seed(0)))
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(AssetError) as caught:
        load_image(path)
    assert str(caught.value).startswith(str(path))
    assert str(caught.value).endswith(".")
    assert "\n" not in str(caught.value)


def test_an_exr_of_absurd_size_is_refused(tmp_path: Path) -> None:
    save_image(tmp_path / "a.exr", torch.rand(4, 4, 3))
    data = (tmp_path / "a.exr").read_bytes()
    window, absurd = struct.pack("<4i", 0, 0, 3, 3), struct.pack("<4i", 0, 0, 99_999_999, 99_999_999)
    (tmp_path / "a.exr").write_bytes(data.replace(window, absurd))
    with pytest.raises(AssetError, match=r"a\.exr"):
        load_image(tmp_path / "a.exr")


def test_a_png_of_absurd_size_is_refused(tmp_path: Path) -> None:
    save_image(tmp_path / "a.png", torch.rand(4, 4, 3))
    data = (tmp_path / "a.png").read_bytes()
    head = b"IHDR" + struct.pack(">2I", 14_000, 14_000) + data[24:29]  # Pillow's limit is 13,377 squared
    absurd = data[:12] + head + struct.pack(">I", zlib.crc32(head)) + data[33:]
    (tmp_path / "a.png").write_bytes(absurd)
    with pytest.raises(AssetError, match=r"a\.png cannot be read as a picture: Image size"):
        load_image(tmp_path / "a.png")
    with pytest.raises(UnreadablePicture):
        decode_picture(absurd, None)


def test_a_png_of_more_pixels_than_its_bytes_can_hold_is_refused(tmp_path: Path) -> None:
    """Its data end, so that Pillow would make the other rows black."""
    save_image(tmp_path / "a.png", torch.rand(4, 4, 3))
    data = (tmp_path / "a.png").read_bytes()
    head = b"IHDR" + struct.pack(">2I", 4, 12_000_000) + data[24:29]
    claims = data[:12] + head + struct.pack(">I", zlib.crc32(head)) + data[33:]
    (tmp_path / "a.png").write_bytes(claims)
    for load in (load_image, load_grey):
        with pytest.raises(AssetError, match="says that it has 4 x 12000000 pixels, which its bytes cannot hold"):
            load(tmp_path / "a.png")
    with pytest.raises(UnreadablePicture, match="which its bytes cannot hold"):
        decode_picture(claims, None)


@pytest.mark.parametrize("mode", ["L", "LA", "P", "RGB", "RGBA", "I;16"])
def test_grey_is_the_mean_of_the_colours_times_alpha(
    tmp_path: Path, mode: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where the picture is read by strips of some rows."""
    monkeypatch.setattr("svbrdfgan.io.image._STRIP", 15)
    codes = np.random.default_rng(3).integers(0, 256, (8, 5, 4), np.uint8)
    if mode == "I;16":
        Image.fromarray(codes[..., 0].astype(np.uint16) * 257).save(tmp_path / "a.png")
    else:
        Image.fromarray(codes[..., : 4 if "A" in mode else 3]).convert(mode).save(tmp_path / "a.png")
    with Image.open(tmp_path / "a.png") as stored:
        shown = np.asarray(stored)[..., None] / 257 if mode == "I;16" else np.asarray(stored.convert("RGBA"))
    shown = torch.from_numpy(shown.astype(np.float32)) / 255
    wanted = shown[..., :3].mean(dim=-1) * (shown[..., 3] if shown.shape[-1] == 4 else 1.0)
    torch.testing.assert_close(load_grey(tmp_path / "a.png"), wanted, atol=1e-6, rtol=0)


@pytest.mark.parametrize(
    ("name", "shape"),
    [("a.gif", (2, 2, 3)), ("a.jpg", (2, 2, 4)), ("a.hdr", (2, 2, 4)), ("a.png", (2, 2)), ("a.png", (2, 2, 2))],
)
def test_what_cannot_be_written_is_refused(tmp_path: Path, name: str, shape: tuple[int, ...]) -> None:
    with pytest.raises(AssetError, match=name):
        save_image(tmp_path / name, torch.zeros(shape))
    assert list(tmp_path.iterdir()) == []


def test_an_exr_without_colors_says_what_it_has(tmp_path: Path) -> None:
    save_exr(tmp_path / "a.exr", {"u": torch.zeros(2, 2), "w": torch.zeros(2, 2)})
    with pytest.raises(AssetError, match="u, w"):
        load_image(tmp_path / "a.exr")


def test_channels_of_several_shapes_are_refused(tmp_path: Path) -> None:
    with pytest.raises(AssetError, match="one shape"):
        save_exr(tmp_path / "a.exr", {"u": torch.zeros(2, 2), "w": torch.zeros(2, 3)})
    with pytest.raises(AssetError, match="one shape"):
        save_exr(tmp_path / "a.exr", {})


@pytest.mark.parametrize(("bits", "kind", "most"), [(8, np.uint8, 255), (16, np.uint16, 65535)])
def test_codes_are_stored_as_they_are(bits: Any, kind: type, most: int, tmp_path: Path) -> None:
    codes = torch.tensor([[0, 1, most], [7, 130, 255]])
    save_codes(tmp_path / "codes.png", codes, bits)
    with Image.open(tmp_path / "codes.png") as image:
        stored = np.asarray(image)
    assert stored.dtype == kind
    assert stored.tolist() == codes.tolist()


def test_an_exr_whose_header_is_no_text_is_told(tmp_path: Path) -> None:
    """The library quotes it in its message, which then cannot be decoded."""
    save_exr(tmp_path / "a.exr", {"R": torch.zeros(4, 4)})
    broken = (tmp_path / "a.exr").read_bytes().replace(b"channels\0chlist\0", b"channels\0chl\xffst\0")
    (tmp_path / "a.exr").write_bytes(broken)
    with pytest.raises(AssetError, match="cannot be read as a picture: its header is no text"):
        load_exr(tmp_path / "a.exr")


def test_pictures_of_too_many_pixels_are_refused_before_they_are_decoded(tmp_path: Path) -> None:
    Image.new("1", (13_000, 13_000)).save(tmp_path / "a.png")
    with pytest.raises(AssetError, match="it has 13000 x 13000 pixels; at most 67 million"):
        load_image(tmp_path / "a.png")


CUT_OFF = """
import resource, sys
from pathlib import Path
import numpy as np
from svbrdfgan.errors import AssetError
from svbrdfgan.io.exr import write_floats

resource.setrlimit(resource.RLIMIT_FSIZE, (300, 300))
for name in ("a.exr", "a.hdr"):
    try:
        write_floats(Path(sys.argv[1]) / name, ("R", "G", "B"), np.random.default_rng(1).random((8, 16, 3), np.float32))
    except AssetError as error:
        sys.stderr.write(f"{error}\\n")
"""


@pytest.mark.skipif(os.name != "posix", reason="the limit is that of POSIX")
def test_small_files_that_a_full_disk_cuts_off_are_told(tmp_path: Path) -> None:
    """OpenImageIO says nothing of them."""
    ended = subprocess.run([sys.executable, "-c", CUT_OFF, str(tmp_path)], capture_output=True, text=True)
    assert [line.rpartition(" cannot be written ")[2] for line in ended.stderr.splitlines()] == [
        "(it was cut off); check the folder and its free space."
    ] * 2
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("suffix", [".exr", ".hdr"])
def test_a_float_picture_is_refused_if_it_needs_more_memory_than_is_allowed(tmp_path: Path, suffix: str) -> None:
    path, bytes_of_values = tmp_path / f"a{suffix}", 64 * 32 * 3 * 4
    save_image(path, torch.rand(32, 64, 3))
    said = r"64 x 32 pixels of 3 channels, which need about .* are allowed; make it smaller\.$"
    with limited(bytes_of_values), pytest.raises(AssetError, match=said):
        load_image(path)
    with limited(5 * bytes_of_values):
        assert load_image(path).shape == (32, 64, 3)
