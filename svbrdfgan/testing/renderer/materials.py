"""Gloss and metal where `roughness` and `metallic` are declared: `docs/conventions.md`, against quadrature."""

from __future__ import annotations

import math

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.testing import scenes
from svbrdfgan.testing.kit import check, declared
from svbrdfgan.testing.renderer.brightness import Inputs, MeasuredKit, expected
from svbrdfgan.types import Environment, Materials, View

GREY = scenes.lambertian((0.1, 0.1, 0.1))
UNIFORM = scenes.constant_light()
MIRRORED = scenes.sun(4, 16, 16, 32)
"""A large sun that the floor mirrors towards a viewer in front (+Z), 45 degrees above it."""


class MaterialTests(MeasuredKit):
    """Values of the formulas, the lower bound of roughness, and the lookup of the maps."""

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

    def test_light_and_viewer_may_be_exchanged(self) -> None:
        """Gloss and metal are reciprocal: exchanging light and viewer changes the cosine alone."""
        _declares(self)
        pixels = (22, 100), (38, 20)  # of the environment's 64 x 128, on one side of the plane each
        turned, plane = (scenes.sun(*pixel) for pixel in pixels), scenes.square((0.0, 0.0, 1.0))
        light = dict(zip(pixels, turned, strict=True))
        cases: list[Inputs] = []
        for seen, lit in (pixels, pixels[::-1]):
            view = scenes.spot_view((0.0, 0.0, 0.0), tuple(scenes.sun_direction(*seen)), light[lit])
            cases += [(plane, materials, view) for materials in _dielectric_and_metal(self, 0.8)]
        runs = self.brightnesses(*cases, spp=64)
        cosines = [float(scenes.sun_direction(*lit)[2]) for lit in pixels[::-1]]
        for kind in range(len(cases) // 2):
            both = runs[:, kind :: len(cases) // 2]
            self.check_ratios(both, cosines, "The same two directions, first for light and viewer, then exchanged.")

    def test_metal_is_tinted(self) -> None:
        """Metal reflects its base colour where light is steep, and more of all where it grazes."""
        _declares_metal(self)
        light = scenes.constant_light(1.0, 16, 32)
        views = [_floor_view(degrees, light) for degrees in (20.0, 80.0)]
        cases: list[Inputs] = [(scenes.floor(), metal((0.9, 0.5, 0.1), 0.4), view) for view in views]
        _check_channels(self, [*cases, (scenes.floor(), GREY, views[0])], "Gold, from 20 and 80 degrees, and a grey.")

    def test_metal_has_no_diffuse_term(self) -> None:
        """Where a metal does not mirror the light it is dark."""
        _declares_metal(self)
        view = _floor_view(60.0, scenes.row_lights(0, rows=16))
        cases: list[Inputs] = [(scenes.floor(), metal((0.8, 0.8, 0.8), rough), view) for rough in (0.3, 0.4)]
        _check_beside_grey(self, cases, view, "White metal of roughness 0.3 and 0.4, lit from above, and a grey.")

    def test_metal_in_uniform_light_is_the_formulas(self) -> None:
        """In uniform light white metal is nearly white, as by quadrature."""
        _declares_metal(self)
        view = _floor_view(60.0, scenes.constant_light(1.0, 16, 32))
        cases: list[Inputs] = [(scenes.floor(), metal((1.0, 1.0, 1.0), rough), view) for rough in (0.35, 0.7, 1.0)]
        cases.append((scenes.floor(), scenes.lambertian((0.8, 0.8, 0.8)), view))
        runs, truth = self.brightnesses(*cases, spp=256), expected(*cases, split=8).mean(axis=-1)
        self.check_ratios(runs, truth, "White metal of roughness 0.35, 0.7 and 1, and a Lambertian grey.")

    def test_metallic_mixes(self) -> None:
        """Between 0 and 1 `metallic` mixes a dielectric and a metal; without it there is no metal."""
        _declares_metal(self)
        view = _floor_view(45.0, MIRRORED)
        mixed = [metal((0.8, 0.4, 0.2), 0.5, metallic) for metallic in (0.0, 0.3, 1.0)]
        cases: list[Inputs] = [(scenes.floor(), each, view) for each in (*mixed, glossy((0.8, 0.4, 0.2), 0.5))]
        _check_channels(self, cases, "Metallic 0, 0.3 and 1, and no such map.")

    def test_metallic_maps_lie_as_textures(self) -> None:
        """Texels of a metallic map lie where those of a base colour would."""
        _declares_metal(self)
        texels = torch.tensor([[0.0, 0.3], [0.6, 1.0]])[..., None]
        towards = (0.0, 1.0, 1.0)
        spots = [scenes.spot_view((x, 0.0, -y), towards, MIRRORED) for y in (-0.5, 0.5) for x in (-0.5, 0.5)]
        cases: list[Inputs] = [(scenes.floor(), metal((0.9, 0.9, 0.9), 0.5, texels), view) for view in spots]
        runs, truth = self.brightnesses(*cases), expected(*cases, split=8).mean(axis=-1)
        self.check_ratios(runs, truth, "Texels (0, 0), (0, 1), (1, 0), (1, 1) of metallic 0, 0.3, 0.6, 1.")

    def test_a_part_without_metallic_stays_a_dielectric(self) -> None:
        """Beside metal, a part with a base colour and a roughness is no metal."""
        _declares_metal(self)
        gloss, view = glossy((0.1, 0.1, 0.1), 0.5), scenes.spot_view((0.5, 0.0, 0.0), (0.3, 0.0, 1.0), UNIFORM)
        mixed = Materials((*metal((0.9, 0.9, 0.9), 0.5).parts, *gloss.parts))
        alone = Materials(gloss.parts * 2)
        runs = self.brightnesses(*((scenes.two_parts(), materials, view) for materials in (mixed, alone)))
        self.check_ratios(runs, [1.0, 1.0], "A glossy part beside metal, and beside another glossy one.")


def _dielectric_and_metal(kit: MeasuredKit, roughness: float) -> list[Materials]:
    """Materials of one roughness; metal where the renderer knows it."""
    able = "metallic" in kit.capabilities.maps
    return [glossy((0.1, 0.1, 0.1), roughness)] + [metal((0.5, 0.5, 0.5), roughness)] * able


def _declares_metal(kit: MeasuredKit) -> None:
    declared("metallic" in kit.capabilities.maps, "metallic")


def _check_channels(kit: MeasuredKit, cases: list[Inputs], message: str) -> None:
    """Fails unless all channels of all cases are to one another as quadrature says."""
    runs = kit.radiances(*cases, spp=32)
    kit.check_ratios(runs.reshape(len(runs), -1), expected(*cases, split=8).reshape(-1), f"{message} Red, green, blue.")


def metal(
    base_color: tuple[float, float, float], roughness: float, metallic: float | Float[Tensor, "rows cols 1"] = 1.0
) -> Materials:
    """One material with all of gloss, a metal unless `metallic` says more."""
    return Materials((scenes.material(base_color=base_color, roughness=roughness, metallic=metallic),))


def _declares(kit: MeasuredKit) -> None:
    declared("roughness" in kit.capabilities.maps, "roughness")


def _picture(kit: MeasuredKit, materials: Materials, view: View) -> Float[Tensor, "height width 3"]:
    return kit.render(scenes.floor(), materials, view, spp=16, seed=4).image


def _check_beside_grey(kit: MeasuredKit, cases: list[Inputs], view: View, message: str) -> None:
    every: list[Inputs] = [*cases, (scenes.floor(), GREY, view)]
    kit.check_ratios(kit.brightnesses(*every, spp=32), expected(*every, split=8).mean(axis=-1), message)


def glossy(base_color: tuple[float, float, float], roughness: float | Float[Tensor, "rows cols 1"]) -> Materials:
    """One material, the base colour under a dielectric's gloss."""
    return Materials((scenes.material(base_color=base_color, roughness=roughness),))


def _floor_view(degrees: float, light: Environment) -> View:
    """A view of the floor's middle, so far from straight down."""
    angle = math.radians(degrees)
    return scenes.spot_view((0.0, 0.0, 0.0), (0.0, math.cos(angle), math.sin(angle)), light)
