"""Files are whole or not there."""

import subprocess
import sys
from pathlib import Path

import pytest

from svbrdfgan.errors import AssetError
from svbrdfgan.io.atomic import atomic_path


def test_a_file_appears_when_the_block_ends(tmp_path: Path) -> None:
    target = tmp_path / "new" / "a.png"
    with atomic_path(target) as temporary:
        temporary.write_text("whole")
        assert temporary.suffix == ".png"
        assert temporary.parent == target.parent
        assert not target.exists()
    assert [path.name for path in target.parent.iterdir()] == ["a.png"]
    assert target.read_text() == "whole"


def write_half_and_fail(target: Path) -> None:
    with atomic_path(target) as temporary:
        temporary.write_text("half")
        raise ZeroDivisionError


def test_a_block_that_fails_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    target = tmp_path / "a.txt"
    target.write_text("old")
    with pytest.raises(ZeroDivisionError):
        write_half_and_fail(target)
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_a_folder_that_cannot_be_made_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(AssetError, match="cannot be written"), atomic_path(tmp_path / "file" / "a.txt"):
        pass


def test_importing_the_package_loads_no_mesh_or_picture_library() -> None:
    code = "import sys, svbrdfgan.io; print([m for m in ('trimesh', 'OpenImageIO', 'PIL.Image') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
