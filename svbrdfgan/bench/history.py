"""The history of a machine's figures: a file of JSON lines, to which each run adds its own and is compared with."""

from __future__ import annotations

import subprocess
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from svbrdfgan import __version__
from svbrdfgan.bench.run import Result
from svbrdfgan.bench.table import LABELS, TextTable, milliseconds
from svbrdfgan.config.models import StrictModel, validate
from svbrdfgan.errors import AssetError
from svbrdfgan.io.atomic import atomic_path
from svbrdfgan.utils.named_files import parse_json, read_text

_KEY = ("processor", "cores", "device", "program", "scene", "vertices", "pixels", "texels", "spp", "batch")


class Entry(StrictModel):
    """The figures of one program on one scene.

    Attributes:
        date: of UTC, ISO 8601.
        commit: of the package's repository, with "-dirty" if files differ from it; else its version.
        seconds: by step, as in `STEPS`.
    """

    date: str
    commit: str
    processor: str
    cores: int
    device: str
    program: str
    scene: str
    vertices: int | None
    pixels: int
    texels: int
    spp: int
    batch: int
    seconds: dict[str, float]

    @property
    def key(self) -> tuple[Any, ...]:
        """What must be equal for entries to be compared."""
        return tuple(getattr(self, name) for name in _KEY)


def entries_of(results: Iterable[Result], machine: Mapping[str, Any], texels: int) -> list[Entry]:
    """The entries of a run.

    Args:
        machine: as in `Report`.
        texels: along a side of the texture.
    """
    now, commit = datetime.now(UTC).isoformat(timespec="seconds"), commit_of(Path(__file__).parent)
    told = {"date": now, "commit": commit, "processor": machine["processor"], "cores": machine["cores"] or 0}
    return [
        Entry(
            **told,
            **asdict(result.case),
            texels=texels,
            device=each.device,
            program=each.name,
            seconds=dict(each.seconds),
        )
        for result in results
        for each in result.programs
    ]


def commit_of(folder: Path) -> str:
    """The commit of the repository that a folder is in; the package's version where there is none, or no git."""
    try:
        words = ["git", "-C", str(folder), "describe", "--always", "--dirty", "--match=-", "--abbrev=12"]
        return subprocess.run(words, capture_output=True, text=True, check=True, timeout=30).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return __version__


def read_history(path: Path) -> list[Entry]:
    """The entries of a file, the oldest first; none if there is no file yet.

    Raises:
        AssetError: the file cannot be read, or is no history.
        ConfigError: an entry has an unknown key or an invalid value.
    """
    if not path.exists():
        return []
    try:
        lines = [line for line in read_text(path).splitlines() if line.strip()]
        return [validate(Entry, parse_json(line), f"{path}, line {n}") for n, line in enumerate(lines, 1)]
    except OSError as error:
        raise AssetError(f"{path} cannot be read: {error.strerror or error}.") from error
    except ValueError as error:
        raise AssetError(f"{path} is no history of figures: {error}.") from error


def write_history(path: Path, entries: Iterable[Entry]) -> None:
    """Writes all entries of a file, a line for each.

    Raises:
        AssetError: the file cannot be written.
    """
    with atomic_path(path) as temporary:
        temporary.write_text("".join(f"{entry.model_dump_json()}\n" for entry in entries), encoding="utf-8")


def comparison(now: Sequence[Entry], before: Sequence[Entry]) -> TextTable | None:
    """What became faster since the last entry of the same work on the same machine; None if there is none.

    Machines are noisy: what a peer, which did not change, became faster by is a measure of that.
    """
    latest = {entry.key: entry for entry in before}
    pairs = [(entry, latest[entry.key]) for entry in now if entry.key in latest]
    rows = [row for pair in pairs for row in _rows(*pair)]
    if not rows:
        return None
    return TextTable(
        "Since the last time on this machine", ("", "step", "scene", "since", "ms", "times faster"), tuple(rows)
    )


def _rows(now: Entry, before: Entry) -> Iterator[tuple[str, ...]]:
    for step, seconds in now.seconds.items():
        if (then := before.seconds.get(step)) and seconds:
            since = f"{before.date[:10]} {before.commit}"
            scene = f"{now.scene}, {now.spp} spp"
            yield now.program, LABELS[step], scene, since, milliseconds(seconds), f"{then / seconds:.2f}"
