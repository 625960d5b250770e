"""Small scenes on which gradients and means are tested, and a renderer with one of them prepared."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray
from torch import Tensor

from svbrdfgan.protocols import RendererCapabilities
from svbrdfgan.rendering.checked_renderer import CheckedRenderer
from svbrdfgan.testing import scenes
from svbrdfgan.testing.statistics import numbers
from svbrdfgan.types import Camera, Environment, Gradients, Material, Materials, Surface, View

Picture = Float[ndarray, "height width 3"]


@dataclass(frozen=True, eq=False)
class Case:
    """A surface, its materials and a view of it."""

    surface: Surface
    materials: Materials
    view: View

    def with_map(self, part: int, name: str, value: Tensor) -> Case:
        """A copy with another map in one part."""
        parts = list(self.materials.parts)
        parts[part] = Material({**parts[part].maps, name: value})
        return replace(self, materials=Materials(tuple(parts)))

    def lit_by(self, radiance: Tensor) -> Case:
        """A copy with other radiance in the environment."""
        environment = Environment(radiance, self.view.environment.rotation)
        return replace(self, view=replace(self.view, environment=environment))

    def smooth(self) -> Picture:
        """A cotangent that is positive and changes little from pixel to pixel."""
        y, x, channel = np.indices((self.view.height, self.view.width, 3))
        return 1.0 + 0.4 * np.cos(2.0 * x / self.view.width + channel) * np.sin(1.0 + 2.0 * y / self.view.height)

    def random(self) -> Picture:
        """A cotangent of independent normal numbers."""
        return np.random.default_rng(7).normal(size=(self.view.height, self.view.width, 3))


@dataclass(frozen=True, eq=False)
class RenderedCase:
    """A renderer with the surface of a case prepared. It returns NumPy arrays in double precision."""

    renderer: CheckedRenderer
    case: Case

    @cached_property
    def prepared(self) -> Any:
        return self.renderer.prepare(self.case.surface)

    def image(self, case: Case | None = None, *, spp: int = 4, seed: int = 3) -> Picture:
        """The picture of this case, or of another one with the same surface."""
        shown = case or self.case
        return numbers(self.renderer.render(self.prepared, shown.materials, shown.view, spp=spp, seed=seed).image)

    def gradients(self, grad: Picture, *wrt: str, case: Case | None = None, spp: int = 4, seed: int = 3) -> Gradients:
        """The gradient of sum(image * grad)."""
        shown, names, cotangent = case or self.case, frozenset(wrt), torch.from_numpy(grad).float()
        return self.renderer.render_vjp(
            self.prepared, shown.materials, shown.view, cotangent, wrt=names, spp=spp, seed=seed
        )

    def map_gradient(self, grad: Picture, name: str, part: int, *, spp: int = 4, seed: int = 3) -> ndarray:
        return numbers(self.gradients(grad, name, spp=spp, seed=seed).materials[part][name])

    def light_gradient(self, grad: Picture, *, spp: int = 4, seed: int = 3) -> Float[ndarray, "rows cols 3"]:
        gradient = self.gradients(grad, "environment", spp=spp, seed=seed).environment
        if gradient is None:
            raise AssertionError("wrt names the environment, but Gradients.environment is None.")
        return numbers(gradient)


def flat(gradients: Gradients) -> dict[str, ndarray]:
    """All gradients by name, such as "part 0 base_color" and "environment"."""
    maps = {
        f"part {part} {name}": numbers(value)
        for part, material in enumerate(gradients.materials)
        for name, value in material.items()
    }
    light = {} if gradients.environment is None else {"environment": numbers(gradients.environment)}
    return maps | light


def differentiable(capabilities: RendererCapabilities) -> list[str]:
    """All that the renderer can differentiate."""
    return sorted(capabilities.differentiable)


def soft_light(rows: int = 4, cols: int = 8, rotation: float = 0.6) -> Environment:
    """A random environment without dark pixels."""
    light = scenes.random_light(rows, cols, seed=5, rotation=rotation)
    return replace(light, radiance=light.radiance + 0.3)


def side_light(rotation: float = 0.6) -> Environment:
    """A random environment that is brightest on one side, where tilting a normal matters most."""
    light = soft_light(rotation=rotation)
    radiance = 0.2 * light.radiance
    radiance[1, :2] += 3.0
    return replace(light, radiance=radiance)


def sheet(light: Environment | None = None, size: int = 8, texels: tuple[int, int] = (4, 4)) -> Case:
    """A textured plane that fills the picture."""
    view = scenes.front_view(light or soft_light(), width=size, height=size, vertical_fov=0.5)
    return Case(scenes.plane(2.0), scenes.lambertian(scenes.random_texture(*texels)), view)


def whole_sheet(repeat: tuple[bool, bool]) -> Case:
    """A textured plane with its edges in the picture, whose texture repeats or not."""
    view = scenes.front_view(soft_light(), width=12, height=12, vertical_fov=0.7)
    surface = replace(scenes.plane(2.0), repeat=repeat)
    return Case(surface, scenes.lambertian(scenes.random_texture(3, 4)), view)


def strips(light: Environment | None = None) -> Case:
    """Three parts side by side that fill the picture: two with textures shaped alike, one constant.

    They meet between pixels, where no quadrature errs.
    """
    view = scenes.front_view(light or soft_light(), 3.0, width=8, height=8, vertical_fov=0.5)
    pixel = 3.0 * math.tan(0.25) / 4.0
    places = ((-4.0 * pixel, 3.0 * pixel), (-pixel, 3.0 * pixel), (2.0 * pixel, 3.0 * pixel))
    parts = [scenes.quad((x, -1.0, 0.0), (width, 0.0, 0.0), (0.0, 2.0, 0.0)) for x, width in places]
    textures = [scenes.random_texture(2, 3, seed) for seed in (0, 1)]
    return Case(scenes.joined(*parts), scenes.lambertian(*textures, (0.3, 0.5, 0.7)), view)


def corner() -> Case:
    """Three parts that light one another, where paths have several bounces."""
    colors: Sequence[Tensor] = (scenes.random_texture(2, 3), torch.tensor([0.9, 0.5, 0.3]), scenes.random_texture(2, 2))
    return Case(scenes.corner_box(), scenes.lambertian(*colors), scenes.corner_view(soft_light(), 8, 8))


def rich(maps: Collection[str]) -> Case:
    """`corner`, with all these maps: textures in part 0, constants in part 1, and a base colour alone in part 2."""
    case = dressed(corner(), 0, maps)
    constants = {"roughness": [0.5], "metallic": [0.7], "normal": [0.3, -0.2, 0.9]}
    for name in (name for name in constants if name in maps):
        case = case.with_map(1, name, torch.tensor(constants[name]))
    return case


def dressed(case: Case, part: int, maps: Collection[str]) -> Case:
    """A copy with random textures of these maps, but for the base colour, in one part."""
    values = 0.3 + 0.6 * scenes.random_texture(3, 2, seed=3)  # in [0.42, 0.84)
    tilts = scenes.random_texture(2, 3, seed=4) - torch.tensor([0.55, 0.55, -0.4])
    textures = {"roughness": values[..., :1], "metallic": 1.5 * values[..., 1:2] - 0.6, "normal": tilts}
    for name in (name for name in textures if name in maps):
        case = case.with_map(part, name, textures[name])
    return case


def whole(maps: Collection[str], light: Environment | None = None) -> Case:
    """`sheet` with random textures of these maps, seen aslant, and none of its normals bent: gradients are smooth."""
    case = dressed(sheet(light or side_light()), 0, maps)
    return replace(case, view=replace(case.view, camera=Camera((0.7, 0.4, 2.4), vertical_fov=0.35)))


def rim(maps: Collection[str], light: Environment | None = None) -> Case:
    """`sheet` with these maps at a grazing angle, all of its normals turned so far from the viewer that they are bent.

    As they all are, gradients are smooth here, too.
    """
    case = dressed(sheet(light or side_light()), 0, maps)
    if "normal" in maps:
        tilts = 0.5 * scenes.random_texture(2, 3, seed=4) - torch.tensor([0.95, 0.25, -0.5])
        case = case.with_map(0, "normal", tilts)
    return replace(case, view=replace(case.view, camera=Camera((2.0, 0.2, 0.9), vertical_fov=0.2)))


def clear() -> Case:
    """`lidded`, with a coloured lid of textured alpha, and a clear sheet above both."""
    sheet = scenes.quad((-1.5, 1.0, 1.5), (3.0, 0.0, 0.0), (0.0, 0.0, -3.0))
    surface = scenes.joined(scenes.occluder(), sheet)
    surface = scenes.with_alpha(surface, 1.0, np.array([[0.9, 0.2], [0.5, 0.7]]), 0.3)
    materials = scenes.lambertian(scenes.random_texture(4, 4), scenes.random_texture(3, 2, seed=1), (0.2, 0.4, 0.8))
    return Case(surface, materials, lidded().view)


def clear_corner() -> Case:
    """`corner` with a coloured screen of alpha 0.4 across it."""
    bare, screen = corner(), scenes.quad((0.4, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 1.0, 0.0))
    surface = scenes.with_alpha(scenes.joined(bare.surface, screen), 1.0, 1.0, 1.0, 0.4)
    return Case(surface, Materials((*bare.materials.parts, Material.lambertian((0.9, 0.2, 0.5)))), bare.view)


def screened() -> Case:
    """A plane (part 0) of which the picture shows the middle, and a larger one behind it, which it hides whole."""
    behind = scenes.quad((-1.5, -1.5, -1.0), (3.0, 0.0, 0.0), (0.0, 3.0, 0.0))
    materials = scenes.lambertian(scenes.random_texture(8, 8), scenes.random_texture(4, 4))
    view = scenes.front_view(soft_light(), 1.0, width=8, height=8, vertical_fov=0.8)
    return Case(scenes.joined(scenes.plane(2.0), behind), materials, view)


def lidded(light: Environment | None = None) -> Case:
    """A floor from above, half of it beneath a black lid, so that nothing but shadow depends on the lid."""
    camera = Camera((0.0, 3.0, 0.0), up=(0.0, 0.0, -1.0), vertical_fov=0.5)
    materials = scenes.lambertian(scenes.random_texture(4, 4), (0.0, 0.0, 0.0))
    return Case(scenes.occluder(), materials, View(camera, light or soft_light(), 8, 8))


def glossy(roughness: Tensor | float, light: Environment | None = None) -> Case:
    """`sheet` as a dielectric, seen aslant."""
    case = sheet(light)
    camera = Camera((1.5, 0.6, 2.0), vertical_fov=0.35)
    value = torch.as_tensor(roughness, dtype=torch.float32)
    value = value.reshape(1) if value.ndim == 0 else value
    return replace(case.with_map(0, "roughness", value), view=replace(case.view, camera=camera))
