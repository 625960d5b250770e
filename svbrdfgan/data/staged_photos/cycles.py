"""Blender as a camera: finds it, and lets it take pictures."""

from __future__ import annotations

import importlib.util
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from svbrdfgan.errors import AssetError, ConfigError
from svbrdfgan.types.view import Vector
from svbrdfgan.utils.leftovers import scratch_folder

_SCRIPT = Path(__file__).with_name("blender_script.py")
_PLAIN = "-P"  # lets Python find no modules beside the script
_DONE = "photograph "
_SAID = 500  # characters of what Blender said last


@dataclass(frozen=True)
class Second:
    """Another photograph from the same tripod, with the same exposure.

    Attributes:
        photo: the file to write.
        mesh: that stands there then; None for the same.
        flash: the value, before the tone curve and the balance of white, of a white matt surface that faces the flash,
            which is beside the lens, at the target's distance; None without a flash.
    """

    photo: str
    mesh: str | None = None
    flash: float | None = None


@dataclass(frozen=True)
class Shot:
    """All that one photograph depends on, and another from the same tripod.

    Attributes:
        photo: the file to write: JPEG, or EXR without `view`.
        mesh: GLB, in metres, y upwards.
        environment: a picture of it, with `rotation` in radians and `scale` as in `Environment`.
        origin, target: of the camera, which is level; `vertical_fov` in radians.
        f_number: of a 24 mm high sensor; None for a pinhole.
        ground: the floor's linear colour; None for no floor.
        gain: what each channel is multiplied by, for the balance of white.
        exposure_stops: beyond a light meter's; None for radiance as it is.
        view: Blender's view transform; None for linear values.
        noise: deviation at 18 % grey, as a share of it.
        threads: that Cycles may use; None for one on each core.
    """

    photo: str
    mesh: str
    environment: str
    rotation: float
    scale: float
    origin: Vector
    target: Vector
    vertical_fov: float
    width: int
    height: int
    samples: int
    bounces: int
    seed: int
    background: bool = False
    f_number: float | None = None
    ground: Vector | None = None
    gain: Vector = (1.0, 1.0, 1.0)
    exposure_stops: float | None = None
    view: str | None = None
    noise: float = 0.0
    jpeg_quality: int = 90
    second: Second | None = None
    threads: int | None = None


def find_blender(program: str | None = None) -> list[str]:
    """The words that run Blender's Python on a script, which follows with its arguments.

    Args:
        program: a Blender, or a Python with the package `bpy`; by default this Python if it has it, or else `blender`.

    Raises:
        ConfigError: there is none.
    """
    if program is not None:
        path = shutil.which(program)
        if path is None:
            raise ConfigError(f"{program} is no program; name a Blender, or a Python with the package bpy.")
        return [path, _PLAIN] if "python" in Path(path).name.lower() else _background(path)
    if importlib.util.find_spec("bpy") is not None:
        return [sys.executable, _PLAIN]
    if (path := shutil.which("blender")) is not None:
        return _background(path)
    raise ConfigError(
        "no Blender is here: name one with --blender, or install its package with pip install 'svbrdfgan[blender]' "
        "(Python 3.11)."
    )


def take(shots: Sequence[Shot], blender: Sequence[str]) -> Iterator[int]:
    """Takes the photographs in one process; yields the number of each that is done.

    Args:
        blender: as `find_blender` returns it.

    Raises:
        AssetError: Blender does not start, or ended before all were done.
    """
    with scratch_folder() as folder:
        jobs = folder / "jobs.json"
        jobs.write_text(json.dumps([asdict(shot) for shot in shots]), encoding="utf-8")
        said = folder / "said"
        with said.open("w+", encoding="utf-8") as errors:
            process = subprocess.Popen(
                [*blender, str(_SCRIPT), *([] if _PLAIN in blender else ["--"]), str(jobs)],
                stdout=subprocess.PIPE,
                stderr=errors,
                text=True,
                env={**os.environ, "PYTHONPATH": ""},
            )
            done, last = 0, ""
            try:
                assert process.stdout is not None
                for line in process.stdout:
                    last = line.strip() or last
                    if line.startswith(_DONE):
                        yield done
                        done += 1
            finally:
                if done < len(shots):
                    process.kill()
                process.wait()
        if done < len(shots):
            why = said.read_text(encoding="utf-8").strip()[-_SAID:] or last
            raise AssetError(f"Blender ended after {done} of {len(shots)} photographs: {why}")


def _background(path: str) -> list[str]:
    return [path, "--background", "--factory-startup", "--python-exit-code", "1", "--python"]
