"""`python -m svbrdfgan.testing.pairs.make_reference`: makes or continues the stored reference of a slow renderer.

The program samples where most runs are missing for the slow profile, and stops when none is missing or the time is up.
Another run with the same file continues from there.
"""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Iterable, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from functools import cache
from pathlib import Path

import click
import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan import __version__
from svbrdfgan.errors import ConfigError
from svbrdfgan.testing.pairs.pair_scene import SCENES, SceneUnavailableError, make_scene
from svbrdfgan.testing.pairs.quantity import QUANTITIES, RenderedScene, offered
from svbrdfgan.testing.pairs.references import RUNS, SHIPPED, Reference, Stored, load_reference
from svbrdfgan.testing.pairs.sampling import SLOW, Aim
from svbrdfgan.testing.pairs.table import comparisons, maker, prepared

SPP = 8
_FIRST_SEED = 2**40  # far from those that a comparison uses
_AHEAD = 3  # tasks that wait for each process
_SAVE_EVERY = 60.0  # seconds

Key = tuple[str, str]  # scene, quantity


class Work:
    """An unfinished reference, and the runs that it still needs."""

    def __init__(self, renderer: str, scenes: Iterable[str], start: Reference | None = None, first: int = 0) -> None:
        """Continues from `start` without the scenes that have changed; rounds are numbered from `first` at least."""
        fingerprints = {scene: make_scene(scene).fingerprint() for scene in scenes}
        empty = Reference(renderer, __version__, fingerprints, {})
        self.reference = start.joined(empty) if start else empty
        # A reference is to be compared with two renderers more, and to take half of the variance.
        self._aim = Aim(SLOW, comparisons(renderers=3), rivals=True)
        keys = [key for scene in fingerprints for key in _keys(renderer, scene)]
        self._begun = {key: len(self._rounds(key)) for key in keys}
        self._next = {key: max(first, max(self._rounds(key), default=-1) + 1) for key in keys}
        self._needed = {key: self._need(key) for key in keys}

    def begin(self) -> tuple[Key, int] | None:
        """The scene and quantity with most runs missing, and the number of its next round; None if none is missing."""
        key = min(self._begun, key=lambda key: self._begun[key] / self._needed[key])
        if self._begun[key] >= self._needed[key]:
            return None
        self._begun[key] += 1
        self._next[key] += 1
        return key, self._next[key] - 1

    def add(self, key: Key, number: int, values: Float[ndarray, "runs blocks"]) -> None:
        """Adds a round."""
        new = Stored(values, frozenset({number}), SPP * make_scene(key[0]).pixels)
        stored = dict(self.reference.stored)
        stored[key] = stored[key].joined(new) if key in stored else new
        self.reference = Reference(self.reference.renderer, __version__, self.reference.fingerprints, stored)
        self._needed[key] = self._need(key)

    def shares(self) -> Mapping[Key, float]:
        """The share of the runs needed that exist, for each quantity."""
        return {key: min(1.0, len(self._rounds(key)) / needed) for key, needed in self._needed.items()}

    def _rounds(self, key: Key) -> frozenset[int]:
        return self.reference.stored[key].rounds if key in self.reference.stored else frozenset()

    def _need(self, key: Key) -> float:
        if not self._rounds(key):
            return 1.0
        excess = self._aim.excess(QUANTITIES[key[1]], make_scene(key[0]), self.reference.stored[key].runs)
        return max(1.0, excess * len(self._rounds(key)))


def carry_out(work: Work, processes: int, seconds: float, out: Path) -> None:
    """Makes rounds until nothing is missing or the time is up, and saves now and then. Rounds begun are finished."""
    end, saved = time.monotonic() + seconds, time.monotonic()
    tasks: dict[Future[Float[ndarray, " blocks"]], tuple[Key, int, int]] = {}
    done: dict[tuple[Key, int], dict[int, Float[ndarray, " blocks"]]] = {}
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, spawn, initializer=torch.set_num_threads, initargs=(1,)) as pool:
        while True:
            while len(tasks) < _AHEAD * processes and time.monotonic() < end and (begun := work.begin()):
                for run in range(RUNS):
                    seed = _FIRST_SEED + begun[1] * RUNS + run
                    tasks[pool.submit(_measured, work.reference.renderer, *begun[0], seed)] = (*begun, run)
            if not tasks:
                break
            for future in wait(tasks, return_when=FIRST_COMPLETED).done:
                key, number, run = tasks.pop(future)
                runs = done.setdefault((key, number), {})
                runs[run] = future.result()
                if len(runs) == RUNS:
                    work.add(key, number, np.stack([values for _, values in sorted(runs.items())]))
                    del done[key, number]
            if time.monotonic() > saved + _SAVE_EVERY:
                work.reference.save(out)
                saved = time.monotonic()
                click.echo(_summary(work))
    work.reference.save(out)


@cache
def _subject(renderer: str, scene: str) -> RenderedScene:
    rendered = prepared(renderer, maker(renderer, {}), make_scene(scene))
    if rendered is None:
        raise ConfigError(f"renderer {renderer!r} does not follow the paths of the scene {scene!r}, or lacks a map.")
    return rendered


def _keys(renderer: str, scene: str) -> list[Key]:
    rendered = _subject(renderer, scene)
    return [(scene, name) for name, quantity in QUANTITIES.items() if offered(rendered.renderer, quantity)]


def _measured(renderer: str, scene: str, quantity: str, seed: int) -> Float[ndarray, " blocks"]:
    return QUANTITIES[quantity].measure(_subject(renderer, scene), SPP, seed)


def _available(scenes: Iterable[str]) -> list[str]:
    found = []
    for scene in scenes:
        try:
            make_scene(scene)
            found.append(scene)
        except SceneUnavailableError as error:
            click.echo(f"{scene}: left out: {error}")
    return found


def _summary(work: Work) -> str:
    shares = work.shares()
    worst = min(shares, key=lambda key: shares[key])
    samples = sum(stored.runs.samples for stored in work.reference.stored.values())
    whole = sum(share >= 1.0 for share in shares.values())
    return (
        f"{samples:.2e} samples; {whole} of {len(shares)} quantities have all they need; "
        f"least has {worst[1]} of {worst[0]!r}: {shares[worst]:.0%}"
    )


@click.command()
@click.option("--renderer", default="numpy", show_default=True)
@click.option("--minutes", default=30.0, show_default=True, help="Rounds that were begun are still finished.")
@click.option("--processes", default=os.cpu_count() or 1, show_default=True)
@click.option(
    "--out", type=click.Path(path_type=Path), default=SHIPPED, show_default=True, help="Continued if it exists."
)
@click.option("--scene", "scenes", multiple=True, type=click.Choice(list(SCENES)), help="All of them by default.")
@click.option("--merge", multiple=True, type=click.Path(path_type=Path), help="Other references, to be taken in first.")
@click.option("--first-round", default=0, help="Where several machines work at once: 0 on one, 100000 on the next.")
def main(
    renderer: str,
    minutes: float,
    processes: int,
    out: Path,
    scenes: tuple[str, ...],
    merge: tuple[Path, ...],
    first_round: int,
) -> None:
    """Make or continue the stored reference of a slow renderer."""
    start = load_reference(out) if out.exists() else None
    for other in map(load_reference, merge):
        start = start.joined(other) if start else other
    work = Work(renderer, _available(scenes or SCENES), start, first_round)
    carry_out(work, processes, 60.0 * minutes, out)
    for (scene, quantity), share in work.shares().items():
        click.echo(f"{scene:16} {quantity:12} {share:5.0%}")
    click.echo(_summary(work))


if __name__ == "__main__":
    main()
