"""Direct light without random numbers: sums over a grid in each pixel and over cells of the environment.

The reference for the kit, written from `docs/conventions.md` alone. It tests every ray against every triangle, so it
suits surfaces of a few triangles and environments of a few pixels. All in NumPy, in double precision.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray
from scipy.sparse import csr_matrix

from svbrdfgan.testing.rays import Points, seen, shadowed
from svbrdfgan.types import DIELECTRIC_REFLECTANCE, LEAST_ROUGHNESS, Material, Materials, Surface, View

_POINTS_AT_ONCE, _STEP = 128, 1e-3


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
        return self._film(self._radiance)

    def coverage(self) -> Float[ndarray, "height width"]:
        return self._film(np.ones((len(self.points.pixel), 1)))[..., 0]

    def texel_gradients(self, grad_image: Float[ndarray, "height width 3"]) -> list[Float[ndarray, "*shape"]]:
        """For each part, the gradient of sum(image * grad_image) in its base colour, shaped as that."""
        grad = self._at_points(grad_image) * self._gathered[0]
        shapes = [tuple(material.base_color.shape) for material in self.materials.parts]
        lookups = [self._lookup(part, shape) for part, shape in enumerate(shapes)]
        return [(lookup.T @ grad).reshape(shape) for lookup, shape in zip(lookups, shapes, strict=True)]

    def roughness_gradients(
        self, grad_images: Sequence[Float[ndarray, "height width 3"]], part: int
    ) -> Float[ndarray, "grads rows cols 1"]:
        """The gradient of each sum(image * grad_image) in a part's roughness, shaped as that, by differences."""
        more, less = (self._rougher(part, step)._radiance for step in (_STEP, -_STEP))
        slope = (more - less) / (2.0 * _STEP)
        shape = tuple(self.materials[part].maps["roughness"].shape)
        lookup = self._lookup(part, shape)
        pulled = [(slope * self._at_points(grad)).sum(axis=1) for grad in grad_images]
        return np.stack([(lookup.T @ each).reshape(shape) for each in pulled])

    def environment_gradient(self, grad_image: Float[ndarray, "height width 3"]) -> Float[ndarray, "rows cols 3"]:
        """The gradient of sum(image * grad_image) in the environment's radiance."""
        direction, light = cells(self.view, self.split)
        grad, total = self._at_points(grad_image), np.zeros((len(direction), 3))
        for some, diffuse, gloss in self._transfer(direction):
            total += diffuse.T @ (self._base_color[some] * grad[some]) + gloss.T @ grad[some]
        return (light.T @ total).reshape(self.view.environment.radiance.shape)

    @cached_property
    def points(self) -> Points:
        return seen(self.surface, self.view, self.grid)

    @property
    def _radiance(self) -> Float[ndarray, "points 3"]:
        diffuse, gloss = self._gathered
        return self._base_color * diffuse + gloss

    def _rougher(self, part: int, step: float) -> Quadrature:
        parts = list(self.materials.parts)
        maps = parts[part].maps
        parts[part] = Material({**maps, "roughness": maps["roughness"].double() + step})
        return replace(self, materials=Materials(tuple(parts)))

    @cached_property
    def _gathered(self) -> tuple[Float[ndarray, "points 3"], Float[ndarray, "points 3"]]:
        """At each point: the light reflected per unit of base colour, and the light reflected as gloss."""
        direction, light = cells(self.view, self.split)
        radiance = light @ self.view.environment.radiance.detach().cpu().double().numpy().reshape(-1, 3)
        lit = radiance.any(axis=1)
        both = [
            (diffuse @ radiance[lit], gloss @ radiance[lit]) for _, diffuse, gloss in self._transfer(direction[lit])
        ]
        none = np.zeros((0, 3))
        return np.concatenate([none, *(d for d, _ in both)]), np.concatenate([none, *(g for _, g in both)])

    def _transfer(self, direction: Float[ndarray, "cells 3"]) -> Iterator[tuple[slice, ndarray, ndarray]]:
        """Chunks of points with their reflection (points, cells) of unit light: per base colour, and as gloss."""
        roughness, glossy = self._sum_of_lookups("roughness"), self._glossy[self.points.part]
        for first in range(0, len(self.points.pixel), _POINTS_AT_ONCE):
            some = slice(first, first + _POINTS_AT_ONCE)
            normal, to_viewer = self.points.normal[some], self.points.to_viewer[some]
            cosine = np.maximum(normal @ direction.T, 0.0)
            arriving = cosine * ~shadowed(self.points.position[some], direction, self.surface)
            fresnel, gloss = np.zeros((2, *cosine.shape))
            if glossy[some].any():
                cosine_viewer = (normal * to_viewer).sum(axis=1, keepdims=True)
                lobe = dielectric(cosine, cosine_viewer, to_viewer @ direction.T, roughness[some])
                fresnel, gloss = (part * glossy[some, None] for part in lobe)
            yield some, arriving * (1.0 - fresnel) / np.pi, arriving * gloss

    @property
    def _glossy(self) -> Bool[ndarray, " parts"]:
        return np.array(["roughness" in material.maps for material in self.materials.parts])

    @cached_property
    def _base_color(self) -> Float[ndarray, "points 3"]:
        return self._sum_of_lookups("base_color")

    def _sum_of_lookups(self, name: str) -> Float[ndarray, "points channels"]:
        total = np.zeros((len(self.points.pixel), 1))
        for part, material in enumerate(self.materials.parts):
            if name in material.maps:
                texels = material.maps[name].detach().cpu().double().numpy()
                total = total + self._lookup(part, texels.shape) @ texels.reshape(-1, texels.shape[-1])
        return total

    def _lookup(self, part: int, shape: tuple[int, ...]) -> csr_matrix:
        """(points, texels): the weights of a part's texels at the points on it; zero at those on others."""
        rows, cols = shape[:2] if len(shape) == 3 else (1, 1)
        x, y = self.points.uv[:, 0] * cols, self.points.uv[:, 1] * rows
        return bilinear(x, y, rows, cols, self.surface.repeat, (self.points.part == part).astype(float))

    def _film(self, values: Float[ndarray, "points c"]) -> Float[ndarray, "height width c"]:
        pixels = self.view.height * self.view.width
        total = np.stack([np.bincount(self.points.pixel, channel, pixels) for channel in values.T], axis=-1)
        return total.reshape(self.view.height, self.view.width, -1) / self.grid**2

    def _at_points(self, grad_image: Float[ndarray, "height width 3"]) -> Float[ndarray, "points 3"]:
        return grad_image.reshape(-1, 3)[self.points.pixel] / self.grid**2


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


def bilinear(
    x: Float[ndarray, " points"],
    y: Float[ndarray, " points"],
    rows: int,
    cols: int,
    repeat: tuple[bool, bool],
    scale: Float[ndarray, " points"],
) -> csr_matrix:
    """(points, rows * cols): the weights of the four pixels around each point, given in pixels, times `scale`."""
    point, entries = np.arange(len(x)), []
    left, below = np.floor(x - 0.5), np.floor(y - 0.5)
    for col, row in ((left, below), (left + 1, below), (left, below + 1), (left + 1, below + 1)):
        weight = (1.0 - abs(x - 0.5 - col)) * (1.0 - abs(y - 0.5 - row)) * scale
        wrapped = [
            (i % n if again else np.clip(i, 0, n - 1)).astype(int)
            for i, n, again in ((row, rows, repeat[1]), (col, cols, repeat[0]))
        ]
        entries.append((weight, wrapped[0] * cols + wrapped[1]))
    weights, texels = (np.concatenate(each) for each in zip(*entries, strict=True))
    return csr_matrix((weights, (np.tile(point, 4), texels)), shape=(len(x), rows * cols))


def dielectric(
    cosine: ndarray, cosine_viewer: ndarray, between: ndarray, roughness: ndarray
) -> tuple[ndarray, ndarray]:
    """Fresnel's F, and F D G / (4 cosine cosine_viewer): glTF 2.0, appendix B. `between` is the cosine w_i.w_o."""
    square = np.maximum(roughness, LEAST_ROUGHNESS) ** 4
    half = np.sqrt(np.maximum((1.0 + between) / 2.0, 1e-12))
    fresnel = DIELECTRIC_REFLECTANCE + (1.0 - DIELECTRIC_REFLECTANCE) * (1.0 - half) ** 5
    normal_half = (cosine + cosine_viewer) / (2.0 * half)
    spread = square / (np.pi * (normal_half**2 * (square - 1.0) + 1.0) ** 2)
    smith = [c + np.sqrt(square + (1.0 - square) * c**2) for c in (cosine, cosine_viewer)]
    return fresnel, fresnel * spread / (smith[0] * smith[1])
