"""`svbrdfgan dataset pose` says in one sentence what COLMAP has placed, or why nothing is."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from PIL import Image

from svbrdfgan.cli import main
from svbrdfgan.data.photos.pose import PosedPictures


def pose(*words: object) -> Result:
    return CliRunner().invoke(main, ["dataset", "pose", *map(str, words)])


@pytest.mark.parametrize(
    ("posed", "said"),
    [
        (
            PosedPictures(("a.jpg", "b.jpg"), ("c.jpg", "d.jpg"), 0.388),
            "2 of 4 pictures placed, with a mean reprojection error of 0.39 pixels; not placed: c.jpg, d.jpg\n",
        ),
        (PosedPictures(("a", "b"), (), 1.0), "2 of 2 pictures placed, with a mean reprojection error of 1.00 pixels\n"),
    ],
)
def test_it_says_what_is_placed(posed: PosedPictures, said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []
    monkeypatch.setattr("svbrdfgan.data.photos.pose.pose_pictures", lambda *words: calls.append(words[:3]) or posed)
    result = pose("photos", "-o", "sparse", "--masks", "masks")
    assert (result.exit_code, result.stdout) == (0, f"sparse: {said}")
    assert calls == [(Path("photos"), Path("sparse"), Path("masks"))]


def test_without_its_package_it_says_how_to_get_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pycolmap", None)
    for number in range(3):
        Image.new("RGB", (20, 20)).save(tmp_path / f"{number}.png")
    result = pose(tmp_path, "-o", tmp_path / "sparse")
    assert (result.exit_code, result.stdout) == (1, "")
    assert "Error: " in result.stderr
    assert result.stderr.endswith("pip install 'svbrdfgan[colmap]'.\n")
    assert not (tmp_path / "sparse").exists()
