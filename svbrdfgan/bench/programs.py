"""Programs to time, each in its own process: our renderers and peers, by one protocol.

{scene}, {spp}, {batch} and {repeats} in a program's command are replaced. The last line of output is JSON: "peer" (its
name), "spp", "forward_s" and "forward_backward_s" (seconds), and optionally the seconds and bytes of further `STEPS`.
"""

from __future__ import annotations

import json
import math
import os
import shlex
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from svbrdfgan.bench import BenchError
from svbrdfgan.bench.cases import PIXELS, STANDARD, VERTICES, Case
from svbrdfgan.errors import ConfigError
from svbrdfgan.utils.processes import import_path

STEPS = ("prepare", "forward", "forward_backward", "transport", "stored_forward", "stored_forward_backward")
_BACKEND = ("-P", "-m", "svbrdfgan.bench.backend")
_ARGUMENTS = ("{scene}", "--spp", "{spp}", "--batch", "{batch}", "--repeats", "{repeats}")


@dataclass(frozen=True)
class Figures:
    """The figures of a program for one case, by step as in `STEPS`.

    Attributes:
        device: a GPU's name, or "cpu"; empty if the program does not say.
        peak_bytes, torch_bytes: as in `Meter`.
    """

    name: str
    device: str
    seconds: Mapping[str, float]
    peak_bytes: Mapping[str, int]
    torch_bytes: Mapping[str, int]


@dataclass(frozen=True)
class Program:
    """A command, its title for messages, and environment variables that it needs."""

    title: str
    words: tuple[str, ...]
    variables: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def backend(cls, name: str) -> Program:
        """One of the installed renderers, with its default options."""
        words = (sys.executable, *_BACKEND, str(os.getpid()), name, *_ARGUMENTS)
        return cls(f"renderer {name!r}", words, {"PYTHONPATH": import_path()})

    @classmethod
    def peer(cls, command: str) -> Program:
        """Any other program, by its command line for a shell.

        Raises:
            ConfigError: the command is empty, or a quotation in it does not end.
        """
        try:
            words = tuple(shlex.split(command))
        except ValueError as error:
            raise ConfigError(f"peer {command!r} is no command: {str(error).lower()}.") from error
        if not words:
            raise ConfigError("a peer's command is empty; give one that prints a line of JSON.")
        return cls(f"peer {command!r}", words)

    def fits(self, case: Case, spp: int) -> bool:
        """Whether the program can run the case.

        A command without {scene} always renders the standard scene, one without {spp} takes `spp` samples per pixel,
        and one without {batch} renders single pictures.
        """
        standard = (case.scene, case.vertices, case.pixels) == (STANDARD, VERTICES, PIXELS)
        return (
            (standard or self._takes("{scene}"))
            and (case.spp == spp or self._takes("{spp}"))
            and (case.batch == 1 or self._takes("{batch}"))
        )

    def run(self, case: Case, scene: Path, repeats: int) -> Figures:
        """Runs the program and returns its figures.

        Raises:
            BenchError: the program failed, printed no figures, or did other work.
        """
        values = {"{scene}": scene, "{spp}": case.spp, "{batch}": case.batch, "{repeats}": repeats}
        words = [_filled(word, values) for word in self.words]
        try:
            done = subprocess.run(
                words,
                env={**os.environ, **self.variables},
                stdin=subprocess.DEVNULL,
                capture_output=True,
                text=True,
                errors="replace",
            )
        except OSError as error:
            raise BenchError(f"{self.title} cannot be run: {error.strerror or error}.") from error
        if done.returncode:
            raise BenchError(f"{self.title} failed with exit code {done.returncode}: {_last(done.stderr)}")
        try:
            return _read(json.loads(_last(done.stdout)), case.spp)
        except (ValueError, KeyError, TypeError) as error:
            raise BenchError(f"{self.title} gave no figures in its last line: {_describe(error)}.") from error

    def _takes(self, name: str) -> bool:
        return any(name in word for word in self.words)


def faster(before: Figures, after: Figures) -> Figures:
    """The figures of `before`, each step with the lesser seconds of both runs."""
    seconds = {step: min(value, after.seconds.get(step, value)) for step, value in before.seconds.items()}
    return Figures(before.name, before.device, seconds, before.peak_bytes, before.torch_bytes)


def _filled(word: str, values: Mapping[str, object]) -> str:
    for name, value in values.items():
        word = word.replace(name, str(value))
    return word


def _read(line: Any, spp: int) -> Figures:
    if not isinstance(line, dict):
        raise TypeError(f"{line!r} is not an object")
    if line["spp"] != spp:
        raise ValueError(f"it took {line['spp']} samples per pixel, wanted {spp}; pass {{spp}} in its command")
    _ = line["forward_s"], line["forward_backward_s"]
    device = line.get("device", "")
    return Figures(str(line["peer"]), str(device), *(_values(line, suffix) for suffix in ("s", "bytes", "torch_bytes")))


def _values(line: Mapping[str, Any], suffix: str) -> dict[str, Any]:
    found = {step: line[f"{step}_{suffix}"] for step in STEPS if f"{step}_{suffix}" in line}
    for step, value in found.items():
        number = isinstance(value, int | float) and math.isfinite(value) and value >= 0
        if not number or (suffix == "s" and value == 0):
            raise ValueError(f"{step}_{suffix} is {value!r}; wanted a positive number")
    return found


def _last(text: str) -> str:
    lines: Sequence[str] = text.strip().splitlines()
    return lines[-1].strip() if lines else "it printed nothing"


def _describe(error: Exception) -> str:
    if isinstance(error, json.JSONDecodeError):
        return f"{error.doc[:80]!r} is not JSON"
    return f"{error} is missing" if isinstance(error, KeyError) else str(error)
