"""Resources of the process: memory, open files, threads, and two threads that render at once."""

from __future__ import annotations

import ctypes
import gc
import os
import sys
import threading
import unittest
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float

from svbrdfgan.rendering.checked_renderer import CheckedRenderer, PreparedSurface
from svbrdfgan.testing import scenes
from svbrdfgan.testing.kit import check
from svbrdfgan.testing.renderer.base import RendererKit
from svbrdfgan.types import Environment, View

_FIELDS = ("arena", "ordblks", "smblks", "hblks", "hblkhd", "usmblks", "fsmblks", "uordblks", "fordblks", "keepcost")
RENDERS, LONGER = 5, 25  # in each round
ROUNDS = 7
TURNS = 12  # of each of two threads, at least
MOST_TURNS = 50 * TURNS
MEETINGS = 6  # pictures of each of two threads during which the other begins one: then both go on no longer
LATER = 5  # of the rounds count, all but one of them: caches may fill in the first ones
_OF_SCENE = 5000.0
"""Bytes kept of each new scene that count as a leak. Texture and picture are more than twice as large each."""
_OF_RENDER = {"bytes in memory": 100.0, "bytes on the GPU": 100.0, "Python objects": 6.0}
"""Growth with each render of one scene that counts as a leak. Libraries keep an object or two, by chance."""


class ResourceTests(RendererKit):
    """Renders of small scenes keep nothing, and do not disturb one another."""

    def test_memory_does_not_grow(self) -> None:
        """Rendering new scenes again and again keeps nothing of them, nor do pullbacks: finds 5,000 bytes of each."""

        def use(seed: int) -> None:
            _use(self.renderer, self.renderer.prepare(scenes.shuffled(scenes.grid(3), seed)), seed)

        counters = {"bytes in memory": _allocated, **_GPU}
        self._require_no_growth(use, counters, dict.fromkeys(counters, _OF_SCENE))

    def test_nothing_stays_of_a_render(self) -> None:
        """Rendering one scene again and again keeps no 100 bytes, six Python objects, open file or thread of each."""
        counters = {"bytes in memory": _allocated, **_GPU, "Python objects": sys.getallocatedblocks}
        if Path("/proc/self/fd").is_dir():
            counters |= {"open files": _entries("fd"), "threads": _entries("task")}
        prepared = self.renderer.prepare(scenes.plane())
        self._require_no_growth(lambda _: _image(self.renderer, prepared, _view(0)), counters, _OF_RENDER)

    def test_two_threads_may_render_at_once(self) -> None:
        """Pictures that two threads render at the same time are those of each scene by itself.

        Quick pictures seldom meet, since a thread waits for its turn longer than they take. So both go on until enough
        of them have met, or `MOST_TURNS`.
        """
        pairs = [(self.renderer.prepare(s), _view(seed)) for seed, s in enumerate((scenes.sphere(), scenes.plane()))]
        alone = [_image(self.renderer, prepared, view) for prepared, view in pairs]
        start = threading.Barrier(2)
        begun, met = [0, 0], [0, 0]

        def renders(own: int) -> list[torch.Tensor]:
            other = 1 - own
            images: list[torch.Tensor] = []
            start.wait()
            while len(images) < TURNS or (min(met) < MEETINGS and len(images) < MOST_TURNS):
                begun[own] += 1
                before = begun[other]
                images.append(_image(self.renderer, *pairs[own]))
                met[own] += begun[other] > before
            return images

        with _frequent_switches(), ThreadPoolExecutor(2) as threads:
            together = list(threads.map(renders, (0, 1)))
        for what, images, wanted in zip(("first", "second"), together, alone, strict=True):
            wrong = sum(not torch.equal(image, wanted) for image in images)
            check(
                not wrong,
                f"{wrong} of {len(images)} pictures of the {what} of two scenes change beside another thread.",
            )

    def _require_no_growth(
        self, use: Callable[[int], object], counters: Mapping[str, Callable[[], int]], least: Mapping[str, float]
    ) -> None:
        """Fails if a count grows so much, or by one, in all later rounds but one. Caches, and chance, grow in some.

        What grows is looked at again in longer rounds, in which chance is less.
        """
        grown: list[str] = []
        for renders in (RENDERS, LONGER):
            growth = zip(counters, _growth(use, list(counters.values()), renders), strict=True)
            found = {what: each for what, each in growth if np.sort(each)[1] >= least.get(what, 1.0)}
            grown = [f"{what} grew by {', '.join(f'{one:.1f}' for one in each)}" for what, each in found.items()]
            if not grown:
                break
        check(
            not grown,
            f"{' and '.join(grown)} with each render of the last rounds; "
            "what keeps hold of surfaces, textures, pictures, pullbacks, files or threads?",
        )


def _growth(
    use: Callable[[int], object], counters: Sequence[Callable[[], int]], renders: int
) -> Float[np.ndarray, "counters rounds"]:
    """By how much each count grows with each render of the later rounds."""
    levels = []
    for number in range(ROUNDS):
        for seed in range(renders):
            use(renders * number + seed)
        gc.collect()
        levels.append([count() for count in counters])
    return np.diff(levels, axis=0)[-LATER:].T / renders


def _use(renderer: CheckedRenderer, prepared: PreparedSurface, seed: int) -> None:
    """Renders and differentiates new materials in new light, by every method, of the same sizes each time."""
    texture, light = scenes.random_texture(40, 30, seed), scenes.random_light(30, 35, seed)
    view, materials, ones = scenes.front_view(light, 1.0, 30, 28), scenes.lambertian(texture), torch.ones(28, 30, 3)
    renderer.render(prepared, materials, view, spp=1, seed=seed)
    wrt = renderer.capabilities.differentiable
    renderer.render_vjp(prepared, materials, view, ones, wrt=wrt, spp=1, seed=seed)
    if renderer.capabilities.pullback:
        _, pullback = renderer.render_pullback(prepared, materials, view, wrt=wrt, spp=1, seed=seed)
        pullback(ones)
    if renderer.capabilities.deferred:
        stored = renderer.store_light(prepared, view, learnable=(0,), hits=1, spp=1, seed=seed)
        images, to_textures = renderer.shade([stored], texture[None], maps=("base_color",), visit=0, seed=seed)
        to_textures(images)


def _view(seed: int) -> View:
    light = scenes.random_light(6 + seed, 9, seed)
    return scenes.front_view(Environment(light.radiance + seed), width=8 + 3 * seed, height=7)


def _image(renderer: CheckedRenderer, prepared: PreparedSurface, view: View) -> torch.Tensor:
    return renderer.render(prepared, scenes.lambertian(scenes.RED), view, spp=2, seed=3).image


@contextmanager
def _frequent_switches() -> Iterator[None]:
    """Lets Python change threads as often as it can, so that what they share shows."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        yield
    finally:
        sys.setswitchinterval(before)


def _entries(folder: str) -> Callable[[], int]:
    return lambda: len(os.listdir(f"/proc/self/{folder}"))


class _Mallinfo(ctypes.Structure):
    """glibc's `struct mallinfo2`."""

    _fields_ = [(name, ctypes.c_size_t) for name in _FIELDS]


def _allocated() -> int:
    """Bytes allocated and not freed by the C library. Python's small objects lie elsewhere.

    The process's resident pages would not do: they vary by megabytes, as allocators keep what is freed.

    Raises:
        unittest.SkipTest: the C library does not say; glibc does, since 2.33.
    """
    try:
        mallinfo = ctypes.CDLL(None).mallinfo2
    except (AttributeError, OSError, TypeError) as error:
        raise unittest.SkipTest("what a process has allocated is asked of glibc 2.33 or later") from error
    mallinfo.restype = _Mallinfo
    said = mallinfo()
    return int(said.uordblks + said.hblkhd)


_GPU = {"bytes on the GPU": torch.cuda.memory_allocated} if torch.cuda.is_available() else {}
