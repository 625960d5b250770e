"""Worker processes that convert pictures, each with a converter of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.sharedctypes import Synchronized
from pathlib import Path
from typing import Any, TypeVar

from svbrdfgan.data.index import DatasetIndex
from svbrdfgan.data.photos.converter import Converter
from svbrdfgan.data.photos.manifest import Manifest
from svbrdfgan.data.trained_model import TrainedModel
from svbrdfgan.errors import SvbrdfganError
from svbrdfgan.utils.display import Display
from svbrdfgan.utils.processes import shared_count, usual_workers, worker_pool

Wanted = TypeVar("Wanted")
Made = TypeVar("Made")

_CHUNKS = 4
"""Parts, for each process, that work is cut into: neighbouring pictures show one mesh, which is then prepared once."""
_LOOK_SECONDS = 0.5
"""How often a crew looks how many pictures are done, since whole parts come back at once."""
_own: list[tuple[Converter, Synchronized[int]]] = []
"""The converter of this process and the count of pictures that all have done, if it is a worker."""


@dataclass(frozen=True, eq=False)
class Crew:
    """Converters.

    Attributes:
        first: of this process.
        pool: of the others; None if there are none.
        workers: processes in the pool.
        done: how many pictures the pool has worked on; None without one.
    """

    first: Converter
    pool: ProcessPoolExecutor | None = None
    workers: int = 1
    done: Synchronized[int] | None = None

    def map(
        self, work: Callable[[Converter, Wanted], Made], wanted: Sequence[Wanted], display: Display
    ) -> Iterator[Made | SvbrdfganError]:
        """Yields what the work makes of each, in order, and tells the display; an error about one spoils no others."""
        if self.pool is None or self.done is None:
            for one in wanted:
                yield _attempt(work, self.first, one)
                display.advance()
            return
        size, told = max(1, len(wanted) // (_CHUNKS * self.workers)), self.done.value
        parts = [wanted[start : start + size] for start in range(0, len(wanted), size)]
        for future in [self.pool.submit(_here, work, part) for part in parts]:
            while not wait([future], _LOOK_SECONDS).done:
                told = _tell(display, told, self.done.value)
            yield from future.result()
        _tell(display, told, self.done.value)


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
    first = Converter.open(manifest, base, index, folder, model)  # stores all assets, which the others find
    # nor need they try out which renderer works
    given = (manifest.model_copy(update={"renderer": first.chosen}), base, index, folder, model)
    workers = usual_workers(workers, len(manifest.pictures))
    if workers < 2:
        yield Crew(first)
        return
    done = shared_count()
    with worker_pool(workers, "imports pictures", "--workers", _start, (done, *given)) as pool:
        yield Crew(first, pool, workers, done)


def _tell(display: Display, told: int, done: int) -> int:
    display.advance(done - told)
    return done


def unwrap(made: Made | SvbrdfganError) -> Made:
    """What was made.

    Raises:
        SvbrdfganError: the error that was met instead.
    """
    if isinstance(made, SvbrdfganError):
        raise made
    return made


def _start(done: Synchronized[int], *given: Any) -> None:
    _own.append((Converter.open(*given), done))


def _here(work: Callable[[Converter, Wanted], Made], part: Sequence[Wanted]) -> list[Made | SvbrdfganError]:
    (converter, done), made = _own[0], list[Made | SvbrdfganError]()
    for one in part:
        made.append(_attempt(work, converter, one))
        with done.get_lock():
            done.value += 1
    return made


def _attempt(work: Callable[[Converter, Wanted], Made], converter: Converter, one: Wanted) -> Made | SvbrdfganError:
    try:
        return work(converter, one)
    except SvbrdfganError as error:
        return error
