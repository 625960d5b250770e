"""Worker processes that convert pictures, each with a converter of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from svbrdfgan.data.index import DatasetIndex
from svbrdfgan.data.photos.converter import Converter
from svbrdfgan.data.photos.manifest import Manifest
from svbrdfgan.data.trained_model import TrainedModel
from svbrdfgan.errors import SvbrdfganError
from svbrdfgan.utils.processes import cores, worker_pool

Wanted = TypeVar("Wanted")
Made = TypeVar("Made")

_CHUNKS = 4
"""Parts, for each process, that work is cut into: neighbouring pictures show one mesh, which is then prepared once."""
_USUAL = 8
"""Processes, at most, if nobody says how many."""
_own: list[Converter] = []
"""The converter of this process, if it is a worker."""


@dataclass(frozen=True, eq=False)
class Crew:
    """Converters.

    Attributes:
        first: of this process.
        pool: of the others; None if there are none.
        workers: processes in the pool.
    """

    first: Converter
    pool: ProcessPoolExecutor | None
    workers: int

    def map(
        self, work: Callable[[Converter, Wanted], Made], wanted: Sequence[Wanted]
    ) -> Iterator[Made | SvbrdfganError]:
        """Yields what the work makes of each, in order; an error about one spoils no others."""
        if self.pool is None:
            yield from (_attempt(work, self.first, one) for one in wanted)
            return
        size = max(1, len(wanted) // (_CHUNKS * self.workers))
        yield from self.pool.map(partial(_here, work), wanted, chunksize=size)


@contextmanager
def crew(
    workers: int | None,
    manifest: Manifest,
    base: Path,
    index: DatasetIndex,
    folder: Path,
    model: TrainedModel | None,
) -> Iterator[Crew]:
    """Converters as `Converter.open` makes them: with one worker that of this process alone, else also of a pool.

    Args:
        workers: processes in the pool, which are spawned, so that they import the caller's main module; None for one
            on each core, but at most 8, since each takes memory, of a GPU, too.

    Raises:
        AssetError: a process was killed.
    """
    given = (manifest, base, index, folder, model)
    first = Converter.open(*given)  # stores all assets, which the others find
    if workers is None:
        workers = min(cores(), _USUAL)
    workers = min(workers, len(manifest.pictures))
    if workers < 2:
        yield Crew(first, None, 1)
        return
    with worker_pool(workers, "imports pictures", "--workers", _start, given) as pool:
        yield Crew(first, pool, workers)


def unwrap(made: Made | SvbrdfganError) -> Made:
    """What was made.

    Raises:
        SvbrdfganError: the error that was met instead.
    """
    if isinstance(made, SvbrdfganError):
        raise made
    return made


def _start(*given: Any) -> None:
    _own.append(Converter.open(*given))


def _here(work: Callable[[Converter, Wanted], Made], one: Wanted) -> Made | SvbrdfganError:
    return _attempt(work, _own[0], one)


def _attempt(work: Callable[[Converter, Wanted], Made], converter: Converter, one: Wanted) -> Made | SvbrdfganError:
    try:
        return work(converter, one)
    except SvbrdfganError as error:
        return error
