"""The gallery shows what its commands make: each picture is there, with a command that the program accepts."""

import re
import shlex
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import click
import numpy as np
import pytest
from PIL import Image

from svbrdfgan.cli import main

REPOSITORY = Path(__file__).parents[2]
PAGE = (REPOSITORY / "docs" / "gallery.md").read_text(encoding="utf-8")
SHOWN = re.findall(r"!\[[^\]]+\]\((images/gallery/[\w-]+\.jpg)\)", PAGE)
LIMIT = 3e6
"""Bytes of all pictures together."""


@pytest.fixture
def calls(code_blocks: Callable[[str, str], list[str]]) -> list[list[str]]:
    """The commands of the page, a list of words each, without the program's name."""
    lines = "".join(code_blocks("docs/gallery.md", "sh")).replace("\\\n", " ").splitlines()
    return [shlex.split(line, comments=True)[1:] for line in lines if line.startswith("svbrdfgan ")]


def values(call: list[str], *options: str) -> list[str]:
    return [value for option, value in pairwise(call) if option in options]


@pytest.mark.parametrize("name", SHOWN)
def test_a_picture_shows_something(name: str) -> None:
    with Image.open(REPOSITORY / "docs" / name) as picture:
        assert picture.width >= 800
        assert np.asarray(picture.convert("L"), dtype=float).std() > 10


def test_the_gallery_is_large_and_light() -> None:
    files = [REPOSITORY / "docs" / name for name in SHOWN]
    assert len(files) >= 16
    assert sorted(files) == sorted((REPOSITORY / "docs" / "images" / "gallery").iterdir())
    assert sum(file.stat().st_size for file in files) <= LIMIT


def test_each_picture_has_its_command(calls: list[list[str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    pictures = [Path(path).stem for call in calls for path in values(call, "--picture", "--sheet")]
    assert sorted(pictures) == sorted(Path(name).stem for name in SHOWN)
    for name, *arguments in calls:
        command = main.get_command(click.Context(main), name)
        assert command is not None
        command.make_context(name, arguments)


def test_each_file_is_credited(calls: list[list[str]]) -> None:
    credited = set(re.findall(r"^\| `([^`]+)`", PAGE[PAGE.index("## Credits") :], re.MULTILINE))
    assert {source for call in calls for source in (call[1], *values(call, "--environment"))} == credited


@pytest.mark.parametrize("page", ["README.md", "docs/index.md"])
def test_the_first_picture_is_of_the_gallery(page: str) -> None:
    path = REPOSITORY / page
    first = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", path.read_text(encoding="utf-8"))[0]
    assert (path.parent / first).parent == REPOSITORY / "docs" / "images" / "gallery"
    with Image.open(path.parent / first) as picture:
        assert picture.size == (1600, 900)
