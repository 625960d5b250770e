"""Environments: values, orientation, and what is done about broken ones."""

from pathlib import Path

import numpy as np
import pytest
import torch

from svbrdfgan.errors import AssetError
from svbrdfgan.io.environment import load_environment, save_environment
from svbrdfgan.io.exr import save_exr


def sky() -> torch.Tensor:
    """Bright at the zenith, red in the first column, dark below."""
    radiance = torch.zeros(8, 16, 3)
    radiance[0] = 1000.0
    radiance[4, 0] = torch.tensor([2.0, 0.5, 0.25])
    return radiance


@pytest.mark.parametrize("suffix", [".hdr", ".exr"])
def test_row_0_stays_on_top_and_values_survive(tmp_path: Path, suffix: str) -> None:
    save_environment(tmp_path / f"sky{suffix}", sky())
    again = load_environment(tmp_path / f"sky{suffix}")
    assert again.dtype == torch.float32
    torch.testing.assert_close(again, sky(), rtol=0.01, atol=0.0)


def test_an_hdr_written_by_hand_is_read_as_the_format_says(tmp_path: Path) -> None:
    pixels = np.zeros((2, 4, 4), dtype=np.uint8)
    pixels[0, 1] = (128, 64, 32, 129)  # mantissa / 256 * 2^(129 - 128): 1, 0.5, 0.25
    head = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 4\n"
    (tmp_path / "a.hdr").write_bytes(head + pixels.tobytes())
    radiance = load_environment(tmp_path / "a.hdr")
    torch.testing.assert_close(radiance[0, 1], torch.tensor([1.0, 0.5, 0.25]), rtol=0.01, atol=0.0)
    assert radiance.sum() == pytest.approx(1.75, rel=0.01)


def test_nan_is_refused(tmp_path: Path) -> None:
    broken = sky()
    broken[3, 3, 1] = torch.nan
    save_environment(tmp_path / "a.exr", broken)
    with pytest.raises(AssetError, match=r"a\.exr holds NaN in 1 of its pixels"):
        load_environment(tmp_path / "a.exr")


def test_negative_and_infinite_values_are_mended_with_a_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    broken = sky()
    broken[3, 3] = torch.tensor([-1e-3, torch.inf, 0.5])
    save_environment(tmp_path / "a.exr", broken)
    radiance = load_environment(tmp_path / "a.exr")
    torch.testing.assert_close(radiance[3, 3], torch.tensor([0.0, 1000.0, 0.5]))
    assert "1 infinite" in caplog.text
    assert "1 negative" in caplog.text


def test_a_square_picture_is_a_warning(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    save_environment(tmp_path / "a.hdr", torch.ones(8, 8, 3))
    assert load_environment(tmp_path / "a.hdr").shape == (8, 8, 3)
    assert "equirectangular" in caplog.text


def test_grey_becomes_rgb(tmp_path: Path) -> None:
    save_exr(tmp_path / "a.exr", {"Y": torch.full((4, 8), 3.0)})
    assert torch.equal(load_environment(tmp_path / "a.exr"), torch.full((4, 8, 3), 3.0))


def test_other_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(b"x")
    with pytest.raises(AssetError, match=r"wanted one of \.exr, \.hdr"):
        load_environment(tmp_path / "a.png")
    with pytest.raises(AssetError, match="cannot hold an environment"):
        save_environment(tmp_path / "b.png", sky())
    with pytest.raises(AssetError, match="shape"):
        save_environment(tmp_path / "b.exr", torch.ones(4, 8))
