"""Files as Blender opens and renders them.

Blender is the package `bpy` 5.0, which needs CPython 3.11 and is no dependency of the project. It gets a virtual
environment of its own inside that of the tests, made at first use, once for all workers of pytest-xdist: 1 GB. On Linux
it also wants the X client libraries and libGL of the system, though it opens no window.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO
import pytest
from filelock import FileLock
from jaxtyping import Float
from numpy import ndarray

VERSION = "5.0.1"
SCRIPT = Path(__file__).with_name("blender_script.py")
SIZE = (320, 200)
SAMPLES = 8
BOUNCES = 12
MINUTES = 60
BASIS = "KHR_texture_basisu"
NOT_OPENED = frozenset({"EXT_meshopt_compression", BASIS})
"""Extensions that Blender 5.0 refuses where a file requires them."""
FLOATS = 1e-4
"""How far numbers of a matrix may differ."""


@dataclass(frozen=True)
class Opened:
    """A file in Blender: its objects by name, its materials, its actions, and a picture of it."""

    objects: dict[str, dict[str, Any]]
    materials: list[str]
    actions: dict[str, list[float]]
    picture: Float[ndarray, "height width 3"]


@dataclass(frozen=True)
class Seen:
    """How two files differ in Blender: sentences about what is in them, and the largest channel's change per pixel."""

    sentences: list[str]
    change: Float[ndarray, "height width"]


def required() -> bool:
    """Whether tests with Blender must run here: `SVBRDFGAN_REQUIRED_TOOLS` names `blender`."""
    return "blender" in os.environ.get("SVBRDFGAN_REQUIRED_TOOLS", "").split()


def python() -> Path:
    """The Python that has bpy, installed if it is not there.

    Skips the test where there is no CPython 3.11, unless it is required.

    Raises:
        RuntimeError: Blender could not be installed or does not start, or is required where there is no CPython 3.11.
    """
    suitable = sys.executable if sys.version_info[:2] == (3, 11) else shutil.which("python3.11")
    if not suitable and not required():
        pytest.skip("bpy 5.0 needs CPython 3.11, which is not here")
    if not suitable:
        raise RuntimeError("SVBRDFGAN_REQUIRED_TOOLS names blender, but bpy 5.0 needs python3.11, which was not found")
    folder = Path(sys.prefix) / f"blender-{VERSION}"
    folder.parent.mkdir(parents=True, exist_ok=True)
    own = folder / "bin" / "python"
    with FileLock(f"{folder}.lock", timeout=20 * MINUTES):
        if not (folder / "complete").exists():
            ran([suitable, "-m", "venv", "--clear", folder])
            ran([own, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", f"bpy=={VERSION}"])
            ran([own, "-c", "import bpy"])
            (folder / "complete").touch()
    return own


def opened(
    files: Sequence[Path], samples: int = SAMPLES, size: tuple[int, int] = SIZE, bounces: int = BOUNCES
) -> list[Opened]:
    """Each of the files as Blender opens it, seen by the camera that is framed around the first.

    Args:
        size: width and height of the pictures.
        bounces: of light between surfaces; 0 is light from the world alone.

    Raises:
        RuntimeError: Blender could not open or render one of them.
    """
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        pictures = [str(folder / f"{index}.exr") for index in range(len(files))]
        words = {"files": [str(file) for file in files], "pictures": pictures, "size": size, "samples": samples}
        ran([python(), SCRIPT, json.dumps({**words, "bounces": bounces, "answer": str(folder / "answer.json")})])
        answers = json.loads((folder / "answer.json").read_text(encoding="utf-8"))
        return [Opened(**answer, picture=_read(path)) for answer, path in zip(answers, pictures, strict=True)]


def compare(before: Path, after: Path, samples: int = SAMPLES) -> Seen:
    """What Blender shows of the second file and not of the first, or otherwise.

    Materials may have copies, called as the original with a suffix; meshes may have more vertices and UV sets; an
    object without a material may get one that the first file does not have.
    """
    first, second = opened([before, after], samples)
    change = np.abs(first.picture - second.picture).max(axis=2)
    return Seen(sentences(first, second), change)


def sentences(first: Opened, second: Opened) -> list[str]:
    """What is in one of two files and not in the other; see `compare`."""
    return [*_objects(first, second), *_materials(first, second), *_actions(first, second)]


def _objects(first: Opened, second: Opened) -> list[str]:
    lost = [f"object {name!r} is gone." for name in first.objects.keys() - second.objects.keys()]
    new = [f"object {name!r} is new." for name in second.objects.keys() - first.objects.keys()]
    common = sorted(first.objects.keys() & second.objects.keys())
    return [*lost, *new, *(line for name in common for line in _facts(name, first, second))]


def _facts(name: str, before: Opened, after: Opened) -> list[str]:
    first, second, known = before.objects[name], after.objects[name], before.materials
    found = []
    for key in first:
        old, new = first[key], second.get(key)
        if key == "matrix":
            same = new is not None and np.allclose(old, new, atol=FLOATS)
        elif key == "materials":
            same = len(old) == len(new or []) and all(map(_is_copy, old, new or []))
            same = same or (not old and new is not None and len(new) == 1 and new[0] not in known)
        else:
            same = old <= (new or 0) if key in ("vertices", "uv_sets") else old == new
        if not same:
            found.append(f"object {name!r}: its {key} was {old}, is {new}.")
    return found


def _materials(first: Opened, second: Opened) -> list[str]:
    lost = [name for name in first.materials if not any(_is_copy(name, other) for other in second.materials)]
    bare = [name for name, facts in first.objects.items() if facts.get("materials") == []]
    given = {material for name in bare for material in second.objects.get(name, {}).get("materials", [])}
    new = [name for name in second.materials if not any(_is_copy(other, name) for other in [*first.materials, *given])]
    return [*(f"material {name!r} is gone." for name in lost), *(f"material {name!r} is new." for name in new)]


def _actions(first: Opened, second: Opened) -> list[str]:
    return [] if first.actions == second.actions else [f"the actions were {first.actions}, are {second.actions}."]


def _is_copy(name: str, other: str) -> bool:
    return other.startswith(name)


def _read(path: str) -> Float[ndarray, "height width 3"]:
    return np.asarray(OpenImageIO.ImageBuf(path).get_pixels(OpenImageIO.FLOAT))[:, :, :3]


def ran(words: Sequence[str | Path], **environment: str) -> None:
    """Runs a program to its end, without the paths of this Python and with these variables.

    Raises:
        RuntimeError: the program failed.
    """
    apart = {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "PYTHONHOME")}
    done = subprocess.run(
        [*map(str, words)], capture_output=True, text=True, timeout=20 * MINUTES, env=apart | environment, check=False
    )
    if done.returncode:
        raise RuntimeError(f"{' '.join(map(str, words[:4]))} failed: {done.stderr[-2000:]}")
