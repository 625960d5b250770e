"""The picture for a README: its size, its weight, and a row for each vehicle."""

from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from svbrdfgan.report.overview import FurtherColumn, write_overview


@pytest.mark.parametrize(("names", "rows"), [(("a",), 1), (("a", "b", "c"), 3), (tuple("abcdefg"), 4)])
def test_a_row_for_each_of_up_to_four_vehicles(tmp_path: Path, makers, names: tuple[str, ...], rows: int) -> None:
    path = tmp_path / "new" / "overview.png"
    write_overview(tmp_path, makers.make_evaluated(names), path)
    with Image.open(path) as image:
        assert image.format == "PNG"
        assert image.size == (1200, 40 + rows * 246 - 12)
    assert path.stat().st_size < 400_000


def test_truth_and_what_was_learned_differ(tmp_path: Path, evaluated) -> None:
    write_overview(tmp_path, evaluated, tmp_path / "overview.png", rows=1)
    with Image.open(tmp_path / "overview.png") as image:
        pixels = np.asarray(image.convert("RGB")).astype(float)
    truth, learned = pixels[40:, 244:594], pixels[40:, 606:956]
    assert (truth[0] == learned[0]).all()  # the background
    assert np.abs(truth - learned).mean() > 1


def test_a_further_column_is_the_last(tmp_path: Path, makers) -> None:
    red = torch.tensor([1.0, 0.0, 0.0]).expand(16, 24, 3)
    write_overview(
        tmp_path,
        makers.make_evaluated(("a", "b")),
        tmp_path / "overview.png",
        further=FurtherColumn("red", lambda index: red),
    )
    with Image.open(tmp_path / "overview.png") as image:
        assert image.size == (1200, 40 + 2 * 192 - 12)
        pixels = np.asarray(image.convert("RGB")).astype(int)
    for middle in (130, 322):
        assert (np.abs(pixels[middle, 960:1190] - (255, 0, 0)) < 20).all()
        assert not (np.abs(pixels[middle, :930] - (255, 0, 0)) < 20).all(axis=-1).all()
