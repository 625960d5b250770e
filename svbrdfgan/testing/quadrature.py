"""Direct light without random numbers: sums over a grid in each pixel and over cells of the environment.

The reference for the kit, written from `docs/conventions.md` alone: the whole material, tilted normals, and parts that
are not opaque. Every ray is tested against every triangle, which suits surfaces of a few triangles and environments of
a few pixels. All in NumPy, in double precision.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray
from scipy.sparse import csr_matrix

from svbrdfgan.testing.lookups import bilinear
from svbrdfgan.testing.rays import Points, passing, seen
from svbrdfgan.testing.reflection import Shades, reflected
from svbrdfgan.types import Materials, Surface, View

_POINTS_AT_ONCE = 128  # camera hits, each with all cells of the environment: bounds the memory
_STEP = 1e-3  # of central differences, in a map's own unit
_ABSENT = {"base_color": (0.0, 0.0, 0.0), "roughness": (1.0,), "metallic": (0.0,), "normal": (0.0, 0.0, 1.0)}

Gathered = tuple[Float[ndarray, "points 3"], Float[ndarray, "points 3"]]
"""The light that points reflect per unit of base colour, and whatever that is."""


@dataclass(frozen=True, eq=False)
class Quadrature:
    """The picture of one scene, and its derivatives.

    Attributes:
        grid: rays along each side of a pixel.
        split: cells along each side of an environment's pixel; even, so that the lookup is smooth within each.
    """

    surface: Surface
    materials: Materials
    view: View
    grid: int = 4
    split: int = 4

    def image(self) -> Float[ndarray, "height width 3"]:
        """The radiance of the surface, times its coverage."""
        by_color, alone = self._gathered
        return self._film(self._shades.base_color * by_color + alone)

    def coverage(self) -> Float[ndarray, "height width"]:
        return self._film(np.ones((len(self.points.pixel), 1)))[..., 0]

    def texel_gradients(self, grad_image: Float[ndarray, "height width 3"]) -> list[Float[ndarray, "*shape"]]:
        """The gradient of sum(image * grad_image) in each part's base colour, shaped as that."""
        return [self.map_gradients("base_color", (grad_image,), part)[0] for part in range(len(self.materials))]

    def map_gradients(
        self, name: str, grad_images: Sequence[Float[ndarray, "height width 3"]], part: int
    ) -> Float[ndarray, "*shape"]:
        """The gradient of each sum(image * grad_image) in a map of a part: for each, an array shaped as that.

        By central differences, but for `base_color`, in which pictures are linear.
        """
        shape, mine = tuple(self.materials[part].maps[name].shape), self.points.part == part
        linear = name == "base_color"
        slope = self._gathered[0][mine, None, :] * np.eye(3) if linear else self._slopes(name, mine)
        pulled = [np.einsum("pmc,pc->pm", slope, self._at_points(grad)[mine]) for grad in grad_images]
        lookup = self._lookup(part, shape)[mine]
        return np.stack([(lookup.T @ each).reshape(shape) for each in pulled])

    def environment_gradient(self, grad_image: Float[ndarray, "height width 3"]) -> Float[ndarray, "rows cols 3"]:
        """The gradient of sum(image * grad_image) in the environment's radiance."""
        direction, light = cells(self.view, self.split)
        grad, total = self._at_points(grad_image), np.zeros((len(direction), 3))
        for some in self._chunks(len(grad)):
            points, shades = self.points.at(some), self._shades.at(some)
            passes = passing(points.position, direction, self.surface)
            by_color, alone = (each * passes for each in reflected(points, shades, direction))
            total += by_color.T @ (shades.base_color * grad[some]) + alone.T @ grad[some]
        return (light.T @ total).reshape(self.view.environment.radiance.shape)

    @cached_property
    def points(self) -> Points:
        return seen(self.surface, self.view, self.grid)

    def _slopes(self, name: str, mine: Bool[ndarray, " points"]) -> Float[ndarray, "mine channels 3"]:
        """The derivative of the radiance of some points with respect to a map's channels there."""
        shades = self._shades.at(mine)
        steps = _STEP * np.eye(getattr(shades, name).shape[1])
        moved = [replace(shades, **{name: getattr(shades, name) + step}) for step in (*steps, *-steps)]
        radiance = [
            shades.base_color * by_color + alone for by_color, alone in self._gather(self.points.at(mine), moved)
        ]
        more, less = np.split(np.stack(radiance, axis=1), 2, axis=1)
        return np.asarray((more - less) / (2.0 * _STEP))

    @cached_property
    def _gathered(self) -> Gathered:
        return self._gather(self.points, [self._shades])[0]

    def _gather(self, points: Points, variants: Sequence[Shades]) -> list[Gathered]:
        """The light that the points gather with each of these shades."""
        direction, radiance = self._lights
        total = np.zeros((len(variants), 2, len(points.pixel), 3))
        for some in self._chunks(len(points.pixel)):
            passes = passing(points.position[some], direction, self.surface)
            for variant, shades in enumerate(variants):
                for kind, each in enumerate(reflected(points.at(some), shades.at(some), direction)):
                    total[variant, kind, some] = (each * passes) @ radiance
        return [(by_color, alone) for by_color, alone in total]

    @cached_property
    def _lights(self) -> tuple[Float[ndarray, "lit 3"], Float[ndarray, "lit 3"]]:
        """The cells that are not black: directions, and radiance times solid angle."""
        direction, light = cells(self.view, self.split)
        radiance = light @ self.view.environment.radiance.detach().cpu().double().numpy().reshape(-1, 3)
        lit = radiance.any(axis=1)
        return direction[lit], radiance[lit]

    @staticmethod
    def _chunks(count: int) -> Iterator[slice]:
        return (slice(first, first + _POINTS_AT_ONCE) for first in range(0, count, _POINTS_AT_ONCE))

    @cached_property
    def _shades(self) -> Shades:
        glossy = np.array(["roughness" in material.maps for material in self.materials.parts])
        return Shades(glossy[self.points.part], **{name: self._looked_up(name) for name in _ABSENT})

    def _looked_up(self, name: str) -> Float[ndarray, "points channels"]:
        total = np.zeros((len(self.points.pixel), len(_ABSENT[name])))
        for part, material in enumerate(self.materials.parts):
            absent = np.array(_ABSENT[name])
            texels = material.maps[name].detach().cpu().double().numpy() if name in material.maps else absent
            total = total + self._lookup(part, texels.shape) @ texels.reshape(-1, texels.shape[-1])
        return total

    def _lookup(self, part: int, shape: tuple[int, ...]) -> csr_matrix:
        """(points, texels): the weights of a part's texels at the points on it; zero at those on others."""
        rows, cols = shape[:2] if len(shape) == 3 else (1, 1)
        x, y = self.points.uv[:, 0] * cols, self.points.uv[:, 1] * rows
        return bilinear(x, y, rows, cols, self.surface.repeat, (self.points.part == part).astype(float))

    def _film(self, values: Float[ndarray, "points c"]) -> Float[ndarray, "height width c"]:
        pixels = self.view.height * self.view.width
        weighted = (values * self.points.weight[:, None]).T
        total = np.stack([np.bincount(self.points.pixel, channel, pixels) for channel in weighted], axis=-1)
        return total.reshape(self.view.height, self.view.width, -1) / self.grid**2

    def _at_points(self, grad_image: Float[ndarray, "height width 3"]) -> Float[ndarray, "points 3"]:
        return grad_image.reshape(-1, 3)[self.points.pixel] * self.points.weight[:, None] / self.grid**2


def cells(view: View, split: int) -> tuple[Float[ndarray, "cells 3"], csr_matrix]:
    """Directions that share out the sphere, and how much of each environment pixel's light comes along each."""
    rows, cols, _ = view.environment.radiance.shape
    y, x = (np.indices((rows * split, cols * split)).reshape(2, -1) + 0.5) / split
    polar, azimuth = np.pi * y / rows, 2.0 * np.pi * (x / cols - 0.5)
    local = np.stack([np.sin(polar) * np.sin(azimuth), np.cos(polar), -np.sin(polar) * np.cos(azimuth)], axis=-1)
    c, s = np.cos(view.environment.rotation), np.sin(view.environment.rotation)
    solid_angle = np.sin(polar) * 2.0 * np.pi * np.sin(np.pi / rows / split / 2.0) * 2.0 / (cols * split)
    return local @ np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]).T, bilinear(
        x, y, rows, cols, (True, False), solid_angle
    )
