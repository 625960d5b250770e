"""What killed processes left is removed, and nothing else."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from svbrdfgan.utils.leftovers import scratch_folder, temporary_name

LEAVE = """
import os, sys
from pathlib import Path
from svbrdfgan.utils.leftovers import temporary_name
temporary_name(Path(sys.argv[1]) / "a.png").touch()
temporary_name(Path(sys.argv[1]) / "folder").mkdir()
"""


def test_what_ended_processes_left_is_removed(tmp_path: Path) -> None:
    subprocess.run([sys.executable, "-c", LEAVE, str(tmp_path)], check=True)
    left = sorted(path.name for path in tmp_path.iterdir())
    assert len(left) == 2
    pid, machine = left[0].split(".")[2].split("-")
    other = f".a.{pid}-{'0' * 4 if machine[:4] != '0000' else '1' * 4}{machine[4:]}.png"
    kept = {".hidden.1-2.png", "a.png", f".a.{os.getpid()}-{machine}.png", other}
    for name in kept:
        (tmp_path / name).touch()
    made = temporary_name(tmp_path / "b.txt")
    assert {path.name for path in tmp_path.iterdir()} == kept
    assert (made.parent, made.suffix, made.name[:3]) == (tmp_path, ".txt", ".b.")


def test_a_scratch_folder_is_deleted(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("tempfile.gettempdir", lambda: str(tmp_path))
    with scratch_folder() as folder:
        (folder / "file").touch()
        assert folder.parent == tmp_path
    assert list(tmp_path.iterdir()) == []
