"""Large films, environments, textures and sample counts, in scenes that are small otherwise.

A pixel's radiance is a sample of its own, so one picture of many pixels is enough.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan.testing import scenes
from svbrdfgan.testing.kit import check, declared
from svbrdfgan.testing.renderer.brightness import Brightnesses, MeasuredKit
from svbrdfgan.testing.renderer.statistical_assertions import exactly
from svbrdfgan.testing.statistics import numbers
from svbrdfgan.types import Environment, Surface, View

WHITE = scenes.lambertian((1.0, 1.0, 1.0))
_FILMS = (3000, 1), (1, 3000), (400, 300)
_SAMPLES = 5000


class SizeTests(MeasuredKit):
    """Sizes at which buffers, counters and grids of other renderers end."""

    def test_large_films(self) -> None:
        """Films of 3,000 x 1, 1 x 3,000 and 400 x 300 pixels show a square where it is, as bright, and its gradient."""
        for width, height in _FILMS:
            surface, view = _middle(width, height)
            image, coverage = self._picture_with_gradient(surface, view, spp=1)
            rows, cols = (np.abs(np.arange(n) + 0.5 - n / 2) / n for n in (height, width))
            outside = np.maximum.outer(rows * (height > 1), cols * (width > 1))
            inside, there = outside < 0.25 - 1.0 / max(width, height), outside > 0.25 + 1.0 / max(width, height)
            torn = int((coverage[inside] != 1.0).sum() + (coverage[there] != 0.0).sum())
            check(not torn, f"On {width} x {height} pixels a square in the middle is torn in {torn} pixels.")
            shown = image.mean(axis=-1)[inside]
            thirds = shown[: len(shown) // 3 * 3].reshape(3, -1).T
            message = f"White in uniform light on {width} x {height} pixels, in the first, middle and last third."
            self.check_values(thirds, np.ones(3), message)

    def test_thousands_of_samples(self) -> None:
        """With 5,000 samples per pixel picture and gradient are as bright as with few."""
        view = scenes.front_view(scenes.constant_light(), 1.0, 4, 3, 0.5)
        image, coverage = self._picture_with_gradient(scenes.plane(2.0), view, spp=_SAMPLES)
        off = abs(coverage - 1.0).max()
        check(off < 1e-5, f"With {_SAMPLES} samples per pixel, coverage of a filled film is off by {off:.2g}.")
        message = f"White in uniform light with {_SAMPLES} samples per pixel."
        self.check_values(image.reshape(-1, 3), np.ones(3), message)

    def test_large_environments(self) -> None:
        """Every other pixel of a region of 512 x 1,024 pixels lights surfaces of four normals as its integral says."""
        rows, cols = np.indices((512, 1024))
        lit = (rows > 300) & (rows < 420) & (cols > 700) & (cols < 960) & ((rows + cols) % 2 == 1)
        directions = scenes.sun_direction(rows, cols, 512, 1024)
        radiance = torch.from_numpy(np.where(lit, 4.0, 0.0)).float()[..., None].repeat(1, 1, 3)
        normals = np.array([(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.6, 0.0, 0.8), (0.6, -0.8, 0.0)])
        weight = lit * np.sin(math.pi * (rows + 0.5) / 512)
        truth = np.array([(weight * np.einsum("x,xrc->rc", n, directions).clip(min=0.0)).sum() for n in normals])
        light = Environment(radiance)
        found = [self._spot(scenes.square(tuple(n)), tuple(n), light) for n in normals]
        message = "Surfaces that face +X, -Y, and between +X and +Z, +X and -Y."
        self.check_ratios(np.stack(found, axis=1), truth, f"{message} Are pixels lost, or moved?")

    def test_large_textures(self) -> None:
        """A texture of 2,048 x 2,048 texels is looked up where it should be."""
        row, col = np.indices((2048, 2048)) >= 1024
        texture = torch.from_numpy(0.2 + 0.5 * row + 0.25 * col).float()[..., None].repeat(1, 1, 3)
        prepared = self.renderer.prepare(scenes.plane())
        view = scenes.front_view(scenes.constant_light(), 1.0, 2, 2, 2.0 * math.atan(0.01))
        seen, white = (
            numbers(self.renderer.render(prepared, m, view, spp=16, seed=1).image).mean(axis=-1)
            for m in (scenes.lambertian(texture), WHITE)
        )
        wanted, spread = np.array([[0.7, 0.95], [0.2, 0.45]]), 0.06
        message = "Four quarters of 2,048 x 2,048 texels, about the middle"
        check(bool((abs(seen / white - wanted) < spread).all()), f"{message}: {seen / white}; wanted {wanted}.")

    def test_textures_are_not_filtered(self) -> None:
        """A camera sample sees texels, and not their mean over the pixel: there are no mip-maps."""
        declared(self.capabilities.stochastic, "chance")
        texels = torch.rand((512, 512), generator=torch.Generator().manual_seed(0)).round()
        prepared = self.renderer.prepare(scenes.plane(2.0))
        view = scenes.front_view(scenes.constant_light(), 1.0, 16, 16, 0.8)
        seen, white = (
            numbers(self.renderer.render(prepared, m, view, spp=1, seed=1).image).mean(axis=-1)
            for m in (scenes.lambertian(texels[..., None].repeat(1, 1, 3)), WHITE)
        )
        spread = float(np.std(seen[white > 0.0] / white[white > 0.0]))
        message = f"Samples of a texture of black and white texels, 13 x 13 to a pixel, spread by {spread:.3f}"
        check(spread > 0.2, f"{message}; wanted 0.33, that of bilinear lookups.")

    def _picture_with_gradient(
        self, surface: Surface, view: View, *, spp: int
    ) -> tuple[Float[ndarray, "height width 3"], Float[ndarray, "height width"]]:
        """The picture and coverage of white, whose gradient, by the base colour, must be the sum of the picture."""
        prepared = self.renderer.prepare(surface)
        rendering = self.renderer.render(prepared, WHITE, view, spp=spp, seed=1)
        image = numbers(rendering.image)
        if "base_color" in self.capabilities.differentiable:
            ones, wrt = torch.ones(view.height, view.width, 3), frozenset({"base_color"})
            gradients = self.renderer.render_vjp(prepared, WHITE, view, ones, wrt=wrt, spp=spp, seed=1)
            found, size = numbers(gradients.materials[0]["base_color"]), f"{view.width} x {view.height} x {spp}"
            exactly(f"the gradient of {size} samples of white", found, image.sum(axis=(0, 1)))
        return image, numbers(rendering.coverage)

    def _spot(self, surface: Surface, normal: tuple[float, float, float], light: Environment) -> Brightnesses:
        """The radiance of each of 256 pixels that show the same."""
        spot = scenes.spot_view((0.0, 0.0, 0.0), normal, light)
        view = View(spot.camera, light, 16, 16)
        return numbers(self.render(surface, WHITE, view, spp=16, seed=next(self.seeds)).image).mean(axis=-1).ravel()


def _middle(width: int, height: int) -> tuple[Surface, View]:
    """A rectangle that fills the middle half of a film along each axis with more than one pixel."""
    pixel = 1.0 / max(width, height)
    w, h = (n * pixel * (0.5 if n > 1 else 2.0) for n in (width, height))
    view = scenes.front_view(scenes.constant_light(), 1.0, width, height, 2.0 * math.atan(0.5 * height * pixel))
    return scenes.quad((-w / 2, -h / 2, 0.0), (w, 0.0, 0.0), (0.0, h, 0.0)), view
