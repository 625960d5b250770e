"""Pictures of a scene with reference materials on its learnable parts: what each pixel shows besides their material."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.data.exemplar_files import BRIGHTEST
from svbrdfgan.errors import ConfigError
from svbrdfgan.rendering.checked_renderer import CheckedRenderer
from svbrdfgan.scene.description import Scene
from svbrdfgan.scene.subject import Subject
from svbrdfgan.types import Environment, Material, Materials, Rendering, View

_WHITE = torch.ones(3)


def _metal(roughness: float) -> Material:
    maps = {"base_color": _WHITE, "roughness": torch.tensor([roughness]), "metallic": torch.ones(1)}
    return Material(maps)


REFERENCES = MappingProxyType(
    {
        "irradiance": Material.lambertian((1.0, 1.0, 1.0)),
        "sharp reflections": _metal(0.3),
        "blurred reflections": _metal(0.6),
    }
)
"""The materials of a light buffer, white and smooth, in the order of its pictures."""
LIGHT_CHANNELS = 3 * len(REFERENCES)

_CLEAN_SAMPLES = 4
"""Unless something else is asked for, the noise of a clean picture is half that of what is compared with it."""
_BLACK = (0.0, 0.0, 0.0)

_DARK = 1e-3
"""Scales base colours that stand for numbers, so that light which is scattered twice hardly counts."""


def require_reference_materials(renderer: CheckedRenderer) -> None:
    """Checks that a renderer can make light buffers.

    Raises:
        ConfigError: it cannot render one of the reference materials.
    """
    needed = {name for material in REFERENCES.values() for name in material.maps}
    if lacking := sorted(needed - renderer.capabilities.maps):
        raise ConfigError(
            f"discriminator.light_buffer shows light by white metal, and {renderer.name} cannot render "
            f"{', '.join(lacking)}: set discriminator.light_buffer: false, or choose a renderer that can."
        )


@dataclass(frozen=True, eq=False)
class ReferencePictures:
    """Renders a scene with other materials on its learnable parts and on their hidden halves.

    Samples are independent of those of the scene's own picture. Nothing here has a gradient.

    Attributes:
        prepared: the subject's surface, as the renderer prepared it.
        spp: samples per pixel.
        clean_spp: those of `clean` and `beside`; None: `_CLEAN_SAMPLES` times as many.
        stream: another number takes other samples.
    """

    renderer: CheckedRenderer
    prepared: Any
    subject: Subject
    scene: Scene
    view: View
    spp: int
    clean_spp: int | None = None
    stream: int = 0

    def light_buffer(self) -> Float[Tensor, "height width 9"]:
        """Diffuse irradiance (divided by pi), and reflections at roughness 0.3 and 0.6, as `REFERENCES` show them.

        RGB each, linear, premultiplied, in half precision as exemplars are stored. Other parts look as in the scene.
        The buffer depends on geometry, camera and light, and not on the material of the learnable parts.
        """
        painted = self.subject.with_hidden_halves
        images = [
            self._render([white if part in painted else other for part, other in enumerate(self.bare)]).image
            for white in REFERENCES.values()
        ]
        return torch.cat(images, dim=-1).clamp(max=BRIGHTEST).half()

    def clean(self) -> Float[Tensor, "height width 3"]:
        """The picture without the layer: linear, premultiplied, float16."""
        return self._clean(self.bare).image.clamp(max=BRIGHTEST).half()

    def beside(self) -> Rendering:
        """What the other parts add to `clean`, by the same samples."""
        return self._clean(list(self.others.parts))

    @property
    def others(self) -> Materials:
        """The scene's materials with black learnable parts, which under direct light add nothing to a picture."""
        black = Material.lambertian(_BLACK)
        return Materials(tuple(black if n in self.subject.learnable else part for n, part in enumerate(self.bare)))

    @cached_property
    def bare(self) -> list[Material]:
        """The materials without the layer."""
        return list(self.subject.materials(None, self.scene.maps, base_colors=self.scene.materials).parts)

    def _clean(self, materials: list[Material]) -> Rendering:
        return replace(self, spp=self.clean_spp or _CLEAN_SAMPLES * self.spp)._render(materials)

    def gbuffer(self) -> Float[Tensor, "height width 6"]:
        """Mean position and normal over a pixel's learnable samples, times their share of the pixel; for any renderer.

        Positions and normals are rendered as base colours of Lambertian parts under uniform light, and divided by a
        picture of white parts with the same samples, which do not depend on base colours. So samples count by how much
        light reaches them, unlike in the G-buffer of stored light transport; where none does, the result is 0.
        """
        values = self.subject.geometry.to(self.renderer.device).permute(1, 2, 0)
        least = values.amin(dim=(0, 1))
        extent = (values.amax(dim=(0, 1)) - least).clamp(min=1e-6)
        encoded = (values - least) / extent
        marks = self._numbers(torch.tensor([1.0, 1.0, 0.0]), torch.tensor([0.0, 1.0, 0.0]))
        learnable, everything = marks.image[..., :1], marks.image[..., 1:2]
        sums = torch.cat([self._numbers(half, torch.zeros(3)).image for half in encoded.split(3, dim=-1)], dim=-1)
        mean = torch.where(learnable > 0, sums / learnable, 0.0) * extent.to(sums) + least.to(sums)
        share = torch.where(everything > 0, learnable / everything, 0.0) * marks.coverage.unsqueeze(-1)
        return mean * share

    def _numbers(self, learnable: Float[Tensor, "*shape 3"], others: Float[Tensor, " 3"]) -> Rendering:
        """A picture of numbers in [0, 1] under uniform light."""
        view = replace(self.view, environment=Environment(torch.ones(2, 4, 3)))
        painted = set(self.subject.learnable)
        materials = [
            Material.lambertian(_DARK * (learnable if part in painted else others))
            for part in range(len(self.subject.surface.parts))
        ]
        return self._render(materials, view)

    def _render(self, materials: list[Material], view: View | None = None) -> Rendering:
        given = Materials(tuple(materials))
        return self.renderer.render(self.prepared, given, view or self.view, spp=self.spp, seed=self._seed)

    @property
    def _seed(self) -> int:
        """Another seed than the picture's, so that the noise of what stands beside a picture is not the picture's."""
        return ((self.scene.seed + self.stream) * 0x85EBCA6B + 0x5BD1E995) % 2**31
