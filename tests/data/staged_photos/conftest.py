"""A Blender that takes grey pictures, and the Blender of the tests of assets."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[2] / "asset"))


CAMERA = """
import json, os, shutil, sys
from pathlib import Path
from PIL import Image
for number, shot in enumerate(json.loads(Path(sys.argv[1]).read_text())):
    if number >= int(os.environ.get("FILM", 99)):
        sys.exit("out of film")
    with Path(os.environ["ALBUM"]).open("a") as album:
        album.write(json.dumps(shot) + "\\n")
    assert Path(shot["mesh"]).is_file() and Path(shot["environment"]).is_file()
    second = shot["second"]
    if second and second["mesh"]:
        assert Path(second["mesh"]).read_bytes() != Path(shot["mesh"]).read_bytes()
    for photo in [shot["photo"]] + ([second["photo"]] if second else []):
        if photo.endswith(".exr"):
            shutil.copy(os.environ["FRAME"], photo)
        else:
            Image.new("RGB", (shot["width"], shot["height"]), (90, 80, 70)).save(photo)
    print(f"photograph {number} done", flush=True)
"""


@pytest.fixture
def blender(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Stands for a Python with bpy: takes grey pictures, and keeps a list of the shots."""
    (tmp_path / "camera.py").write_text(CAMERA)
    program = tmp_path / "python-of-blender"
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" "{tmp_path}/camera.py" "$3"\n')
    program.chmod(0o755)
    monkeypatch.setenv("ALBUM", str(tmp_path / "album"))
    return str(program)


@pytest.fixture(scope="session")
def blender_python() -> Path:
    """A Python with bpy, installed at first use."""
    from blender import python

    return python()
