"""Gloss where `roughness` is declared: the dielectric of `docs/conventions.md`, against quadrature."""

from __future__ import annotations

import math

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.testing import scenes
from svbrdfgan.testing.kit import check, declared
from svbrdfgan.testing.renderer.measure import Inputs, MeasuredKit, expected
from svbrdfgan.types import Environment, Material, Materials, View

GREY = scenes.lambertian((0.1, 0.1, 0.1))


class RoughnessTests(MeasuredKit):
    """Values of the formula, its lower bound, and the lookup of the map."""

    def test_gloss_shines_at_the_mirror_angle(self) -> None:
        """At the mirror angle gloss is as bright as F D G / (4 cos cos) says."""
        _declares(self)
        light = scenes.row_lights(3, 4, rows=16, cols=32)  # polar angles about 45 degrees
        view = _floor_view(45.0, light)
        cases = [(scenes.floor(), glossy((0.0, 0.0, 0.0), rough), view) for rough in (0.3, 0.5, 0.8)]
        _check_beside_grey(self, cases, view, "Roughness 0.3, 0.5, 0.8 on black, and a Lambertian grey without.")

    def test_gloss_in_uniform_light_is_the_formulas(self) -> None:
        """In uniform light gloss, and the diffuse under it, are as by quadrature."""
        _declares(self)
        light = scenes.constant_light(1.0, 16, 32)
        for degrees in (20.0, 75.0):
            view = _floor_view(degrees, light)
            cases = [(scenes.floor(), glossy((0.3, 0.3, 0.3), rough), view) for rough in (0.4, 1.0)]
            _check_beside_grey(
                self, cases, view, f"Roughness 0.4, 1 seen at {degrees:.0f} degrees, and a Lambertian grey."
            )

    def test_smooth_is_bounded(self) -> None:
        """Roughness below 0.05 looks like 0.05: looked up first, bounded then."""
        _declares(self)
        ramp = torch.tensor([0.0, 0.1])[
            None, :, None
        ]  # 0.025 at the floor's quarter less a half texel, (u, v) = (3/8, 1/2)
        view = scenes.spot_view((-0.25, 0.0, 0.0), (0.4, 1.0, 0.2), scenes.random_light(), extent=0.001)
        bound, zero, between, looked_up = (
            _picture(self, glossy((0.2, 0.2, 0.2), rough), view) for rough in (0.05, 0.0, 0.03, ramp)
        )
        for what, image in (("0", zero), ("0.03", between), ("0.025, between texels 0 and 0.1,", looked_up)):
            off = float((image - bound).abs().max() / bound.max())
            check(off < 1e-3, f"Roughness {what} is off by {off:.3g} from roughness 0.05, with the same seed.")

    def test_a_part_without_roughness_stays_diffuse(self) -> None:
        """Beside a glossy part, one with a base colour alone is Lambertian."""
        _declares(self)
        light = scenes.constant_light(1.0, 4, 8)
        view = scenes.spot_view((0.5, 0.0, 0.0), (0.3, 0.0, 1.0), light)
        mixed = Materials((*glossy((0.1, 0.1, 0.1), 0.4).parts, *GREY.parts))
        alone = Materials(GREY.parts * 2)
        runs = self.brightnesses(*((scenes.two_parts(), materials, view) for materials in (mixed, alone)))
        self.check_ratios(runs, [1.0, 1.0], "A grey part beside a glossy part, and beside another grey one.")

    def test_roughness_maps_lie_as_textures(self) -> None:
        """Texels of a roughness map lie where those of a base colour would."""
        _declares(self)
        texels = torch.tensor([[0.2, 0.4], [0.6, 0.9]])
        light = scenes.row_lights(3, 4, rows=16, cols=32)
        towards = (0.0, 1.0, 1.0)
        spots = [scenes.spot_view((x, 0.0, -y), towards, light) for y in (-0.5, 0.5) for x in (-0.5, 0.5)]
        cases = [(scenes.floor(), glossy((0.0, 0.0, 0.0), texels[..., None]), view) for view in spots]
        runs, truth = self.brightnesses(*cases), expected(*cases, split=8).mean(axis=-1)
        self.check_ratios(runs, truth, "Texels (0, 0), (0, 1), (1, 0), (1, 1) of roughness 0.2, 0.4, 0.6, 0.9.")


def _declares(kit: MeasuredKit) -> None:
    declared("roughness" in kit.capabilities.maps, "roughness")


def _picture(kit: MeasuredKit, materials: Materials, view: View) -> Float[Tensor, "height width 3"]:
    return kit.render(scenes.floor(), materials, view, spp=16, seed=4).image


def _check_beside_grey(kit: MeasuredKit, cases: list[Inputs], view: View, message: str) -> None:
    every: list[Inputs] = [*cases, (scenes.floor(), GREY, view)]
    kit.check_ratios(kit.brightnesses(*every, spp=32), expected(*every, split=8).mean(axis=-1), message)


def glossy(base_color: tuple[float, float, float], roughness: float | Float[Tensor, "rows cols 1"]) -> Materials:
    """One material, the base colour under a dielectric's gloss."""
    rough = roughness if isinstance(roughness, Tensor) else torch.tensor([roughness])
    return Materials((Material({"base_color": torch.tensor(base_color), "roughness": rough}),))


def _floor_view(degrees: float, light: Environment) -> View:
    """Of the floor's middle, so far from straight down."""
    angle = math.radians(degrees)
    return scenes.spot_view((0.0, 0.0, 0.0), (0.0, math.cos(angle), math.sin(angle)), light)
