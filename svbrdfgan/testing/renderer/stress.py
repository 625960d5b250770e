"""Faults that show only with many pictures or large inputs."""

from __future__ import annotations

import ctypes
import dataclasses
import gc
import unittest

import numpy as np
import torch

from svbrdfgan.rendering.checked_renderer import CheckedRenderer, PreparedSurface
from svbrdfgan.testing import scenes
from svbrdfgan.testing.kit import check
from svbrdfgan.testing.renderer.base import RendererKit
from svbrdfgan.types import View

_FIELDS = ("arena", "ordblks", "smblks", "hblks", "hblkhd", "usmblks", "fsmblks", "uordblks", "fordblks", "keepcost")
WHITE = scenes.lambertian((1.0, 1.0, 1.0))
SCENES = 2  # new ones in each round
ROUNDS = 10
LATER = 6  # of the rounds count: caches may fill in the first ones


class StressTests(RendererKit):
    """Many renders, many surfaces, large surfaces."""

    def test_memory_does_not_grow(self) -> None:
        """Rendering new scenes again and again does not leak memory, nor do pullbacks."""
        levels = [_allocated()]
        for number in range(ROUNDS):
            made = _round(self.renderer, number)
            levels.append(_allocated())
        for place in levels[0]:
            later = np.diff([level[place] for level in levels])[-LATER:] / 1e6
            grown = f"grew by {', '.join(f'{each:.3f}' for each in later)} MB with each of the last rounds"
            check(
                float(np.median(later)) < 0.5 * made / 1e6,
                f"What is allocated {place} {grown}, of {SCENES} new scenes and {made / 1e6:.3f} MB of pictures each; "
                "what keeps hold of surfaces, textures, pictures or pullbacks?",
            )

    def test_prepared_surfaces_stay_valid(self) -> None:
        """A prepared surface renders the same after many others came and went."""
        view = scenes.front_view(scenes.random_light(), width=12, height=8)
        first = self.renderer.prepare(scenes.sphere())
        before = self.renderer.render(first, WHITE, view, spp=2, seed=1)
        for rows in range(3, 9):
            other = self.renderer.prepare(scenes.sphere(0.5, rows, 2 * rows))
            self.renderer.render(other, scenes.lambertian(scenes.random_texture(rows, 3)), view, spp=1, seed=rows)
            del other
        gc.collect()
        after = self.renderer.render(first, WHITE, view, spp=2, seed=1)
        same = torch.equal(before.image, after.image) and torch.equal(before.coverage, after.coverage)
        check(
            same, "the same surface, view and seed give another picture after other surfaces were prepared and dropped."
        )

    def test_scenes_may_alternate(self) -> None:
        """Pictures of two scenes in turn are those of each scene by itself."""
        pairs = [(self.renderer.prepare(s), _view(seed)) for seed, s in enumerate((scenes.sphere(), scenes.plane()))]
        alone = [_image(self.renderer, prepared, view) for prepared, view in pairs]
        for _ in range(3):
            for what, (prepared, view), wanted in zip(("first", "second"), pairs, alone, strict=True):
                image = _image(self.renderer, prepared, view)
                check(torch.equal(image, wanted), f"the {what} of two scenes changes when they are rendered in turn.")

    def test_a_hundred_thousand_faces(self) -> None:
        """A plane of 100,352 triangles has no gaps."""
        view = scenes.front_view(scenes.constant_light(), 1.0, 24, 24, 0.8)
        coverage = self.render(scenes.grid(224), WHITE, view, spp=4).coverage
        missing = float((1.0 - coverage).sum()) * 4
        check(
            missing < 3.0, f"{missing:.0f} of {24 * 24 * 4} camera samples pass through a plane of 100,352 triangles."
        )

    def test_large_textures(self) -> None:
        """A texture of 2048 x 1024 texels is looked up where it should be."""
        texture = torch.zeros(1024, 2048, 3)
        texture[:, 1024:] = 1.0
        prepared = self.renderer.prepare(scenes.plane())
        for x, wanted in ((-0.01, 0.0), (0.01, 1.0)):
            view = scenes.spot_view((x, 0.3, 0.0), (0.0, 0.0, 1.0), scenes.constant_light(), extent=0.001)
            seen, white = (
                float(self.renderer.render(prepared, m, view, spp=4, seed=1).image.mean())
                for m in (scenes.lambertian(texture), WHITE)
            )
            check(
                abs(seen - wanted * white) <= 1e-3 * white,
                f"a hundredth beside the middle it is {seen / white:.3f}; wanted {wanted}.",
            )


def _round(renderer: CheckedRenderer, number: int) -> int:
    """Renders and differentiates new scenes, of the same sizes in each round; returns the bytes of the pictures."""
    made = 0
    for size in range(SCENES):
        seed = SCENES * number + size
        texture, light = scenes.random_texture(300 + size, 200, seed), scenes.random_light(60 + size, 130, seed)
        view = scenes.front_view(light, 1.0, 96, 96 + size, 0.8)
        materials = scenes.lambertian(texture)
        prepared = renderer.prepare(scenes.shuffled(scenes.grid(40 + size), seed))
        rendering = renderer.render(prepared, materials, view, spp=1, seed=seed)
        film, wrt = dataclasses.replace(view, width=16, height=16), renderer.capabilities.differentiable
        renderer.render_vjp(prepared, materials, film, torch.ones(16, 16, 3), wrt=wrt, spp=1, seed=seed)
        if renderer.capabilities.pullback:
            _, pullback = renderer.render_pullback(prepared, materials, view, wrt=wrt, spp=1, seed=seed)
            pullback(torch.ones(96 + size, 96, 3))
        if renderer.capabilities.deferred:
            stored = renderer.store_light(prepared, view, learnable=(0,), hits=1, spp=1, seed=seed)
            images, to_textures = renderer.shade([stored], texture[None], maps=("base_color",), visit=0, seed=seed)
            to_textures(images)
        made += rendering.image.nbytes + rendering.coverage.nbytes
    return made


def _view(seed: int) -> View:
    return scenes.front_view(scenes.random_light(6 + seed, 9, seed), width=8 + 3 * seed, height=7)


def _image(renderer: CheckedRenderer, prepared: PreparedSurface, view: View) -> torch.Tensor:
    return renderer.render(prepared, scenes.lambertian(scenes.RED), view, spp=2, seed=3).image


class _Mallinfo(ctypes.Structure):
    """glibc's `struct mallinfo2`."""

    _fields_ = [(name, ctypes.c_size_t) for name in _FIELDS]


def _allocated() -> dict[str, int]:
    """Bytes allocated and not freed, by the C library and by torch on the GPU.

    The process's resident pages would not do: they vary by megabytes, as allocators keep what is freed.

    Raises:
        unittest.SkipTest: the C library does not say; glibc does, since 2.33.
    """
    gc.collect()
    try:
        mallinfo = ctypes.CDLL(None).mallinfo2
    except (AttributeError, OSError, TypeError) as error:
        raise unittest.SkipTest("what a process has allocated is asked of glibc 2.33 or later") from error
    mallinfo.restype = _Mallinfo
    said = mallinfo()
    gpu = torch.cuda.memory_allocated() if torch.cuda.is_available() else 0
    return {"in memory": said.uordblks + said.hblkhd, "on the GPU": gpu}
