"""Cases whose light a renderer stores, to shade them for any maps of their learnable parts."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import torch
from jaxtyping import Float
from numpy import ndarray
from torch import Tensor

from svbrdfgan.rendering.checked_renderer import CheckedLight, CheckedRenderer
from svbrdfgan.testing import scenes
from svbrdfgan.testing.renderer import cases
from svbrdfgan.testing.renderer.cases import Case, Picture, RenderedCase
from svbrdfgan.testing.statistics import numbers
from svbrdfgan.types import CHANNELS, Camera, Environment, Material, Materials

Textures = Float[Tensor, "textures rows cols channels"]
Shaded = tuple[Float[Tensor, "views height width 3"], Callable[[Tensor], Tensor]]

_FILM = 4
_TEXELS = (3, 2)
_CONSTANTS = {"base_color": [0.2, 0.4, 0.8], "roughness": [0.5], "metallic": [0.7], "normal": [0.3, -0.2, 0.9]}
_BLACK = Material.lambertian((0.0, 0.0, 0.0))

_ROTATION = 3.0 * math.pi / 16.0
"""Three quarters of a pixel of eight columns: the horizon of a surface that faces an axis lies between cells of the
quadrature. Else cells across it may err by as much after they were halved as before, and nothing tells.
"""


@dataclass(frozen=True, eq=False)
class StoredCase:
    """A renderer with the surface of a case prepared, some of whose parts are learnable.

    Attributes:
        learnable: parts with a texture for each map, all of one size.
    """

    renderer: CheckedRenderer
    case: Case
    learnable: tuple[int, ...]

    @cached_property
    def rendered(self) -> RenderedCase:
        return RenderedCase(self.renderer, self.case)

    @property
    def maps(self) -> tuple[str, ...]:
        """The maps of the learnable parts, in the order of `shade`."""
        own = self.case.materials[self.learnable[0]].maps
        return tuple(name for name in CHANNELS if name in own)

    @property
    def textures(self) -> Textures:
        """The maps of the learnable parts, as `shade` takes them."""
        parts = (self.case.materials[part].maps for part in self.learnable)
        return torch.stack([torch.cat([maps[name] for name in self.maps], dim=-1) for maps in parts])

    def store(self, *, hits: int, spp: int, seed: int) -> CheckedLight:
        return self.renderer.store_light(
            self.rendered.prepared, self.case.view, learnable=self.learnable, hits=hits, spp=spp, seed=seed
        )

    def shade(self, *lights: CheckedLight, textures: Tensor | None = None, visit: int = 0, seed: int = 0) -> Shaded:
        """The pictures of views of this case, all with its own textures unless others are given, and the pullback."""
        values = self.textures.repeat(len(lights), 1, 1, 1) if textures is None else textures
        return self.renderer.shade(lights, values, maps=self.maps, visit=visit, seed=seed)

    def beside(self, *, spp: int, seed: int) -> Picture:
        """The picture of the parts that are not learnable."""
        parts = [_BLACK if part in self.learnable else m for part, m in enumerate(self.case.materials.parts)]
        return self.rendered.image(replace(self.case, materials=Materials(tuple(parts))), spp=spp, seed=seed)


def shade_together(
    stored: Sequence[StoredCase], lights: Sequence[CheckedLight], *, visit: int, seed: int
) -> Float[ndarray, "views height width 3"]:
    """One batch of views of different cases, which have the same maps."""
    values = torch.cat([each.textures for each in stored])
    first = stored[0]
    images, _ = first.renderer.shade(lights, values, maps=first.maps, visit=visit, seed=seed)
    return numbers(images)


def strips(maps: Sequence[str]) -> Case:
    """`cases.strips` on a small film, where a pixel sees much of a texture; the first two parts have all maps."""
    case = _small(cases.strips(cases.side_light()))
    return _textured(_textured(case, 0, maps, seed=1), 1, maps, seed=2)


def lidded(maps: Sequence[str]) -> Case:
    """`cases.lidded` on a small film: the floor has textures of all maps, the lid constants."""
    case = _textured(_small(cases.lidded(cases.side_light())), 0, maps, seed=3)
    for name in (name for name in maps if name in _CONSTANTS):
        case = case.with_map(1, name, torch.tensor(_CONSTANTS[name]))
    return case


def clear(maps: Sequence[str]) -> Case:
    """`cases.clear` on a small film: floor and lid, of textured alpha, have textures of all maps."""
    return _textured(_textured(_small(cases.clear()), 0, maps, seed=4), 1, maps, seed=5)


def sheet(maps: Sequence[str]) -> Case:
    """`cases.whole` with textures of one size."""
    return _textured(cases.whole(maps, cases.side_light(_ROTATION)), 0, maps, seed=6)


def uniform(light: Environment) -> Case:
    """A Lambertian plane of one colour, of which each pixel has the same radiance in expectation."""
    case = cases.sheet(light, size=16, texels=(1, 1))
    return case.with_map(0, "base_color", torch.full((1, 1, 3), 0.5))


def away(case: Case) -> Case:
    """A view of a case that shows nothing of it."""
    return replace(case, view=replace(case.view, camera=Camera((0.0, 0.0, 30.0), target=(0.0, 0.0, 60.0))))


def _small(case: Case) -> Case:
    return replace(case, view=replace(case.view, width=_FILM, height=_FILM))


def _textured(case: Case, part: int, maps: Sequence[str], seed: int) -> Case:
    """A copy with random textures of one size for all of these maps in one part; no normal is bent."""
    values = scenes.random_texture(*_TEXELS, seed=seed)
    tilts = scenes.random_texture(*_TEXELS, seed=seed + 10) - torch.tensor([0.55, 0.55, -0.4])
    gloss = 0.3 + 0.6 * scenes.random_texture(*_TEXELS, seed=seed + 20)  # in [0.42, 0.84)
    textures = {
        "base_color": values,
        "roughness": gloss[..., :1],
        "metallic": 1.5 * gloss[..., 1:2] - 0.6,
        "normal": tilts,
    }
    for name in maps:
        case = case.with_map(part, name, textures[name])
    return case
