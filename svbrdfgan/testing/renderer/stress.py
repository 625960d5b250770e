"""Faults that show only with many surfaces, or with many faces."""

from __future__ import annotations

import gc

import torch

from svbrdfgan.rendering.checked_renderer import CheckedRenderer, PreparedSurface
from svbrdfgan.testing import scenes
from svbrdfgan.testing.kit import check
from svbrdfgan.testing.renderer.base import RendererKit
from svbrdfgan.types import View

WHITE = scenes.lambertian((1.0, 1.0, 1.0))


class StressTests(RendererKit):
    """Many surfaces, in turn, and of many faces."""

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


def _view(seed: int) -> View:
    return scenes.front_view(scenes.random_light(6 + seed, 9, seed), width=8 + 3 * seed, height=7)


def _image(renderer: CheckedRenderer, prepared: PreparedSurface, view: View) -> torch.Tensor:
    return renderer.render(prepared, scenes.lambertian(scenes.RED), view, spp=2, seed=3).image
