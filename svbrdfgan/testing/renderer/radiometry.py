"""Brightness: pictures with known answers. Most tests compare brightnesses, so that one fault fails one test.

Lights are the same from all sides and surfaces face the camera, so that no fault of orientation shows here.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.testing import scenes
from svbrdfgan.testing.kit import check, declared
from svbrdfgan.testing.renderer.brightness import Brightnesses, Inputs, MeasuredKit, check_zero, expected
from svbrdfgan.testing.statistics import numbers
from svbrdfgan.types import Camera, Environment, Materials, Surface, View

WHITE = scenes.lambertian((1.0, 1.0, 1.0))
UP = (0.0, 1.0, 0.0)
FRONT = (0.0, 0.0, 1.0)
_PRECISE = 1e-3
"""The relative error allowed beside noise where quadrature is exact, and rays start off the surface unnoticed."""


class RadiometryTests(MeasuredKit):
    """Light, cosine, shadow, linearity, coverage, texture filter, interreflection."""

    def test_white_in_uniform_light_is_as_bright_as_the_light(self) -> None:
        """A white plane in uniform light shows the light's own radiance."""
        found = self.radiances(_facing(scenes.constant_light(0.5)), spp=128)
        self.check_values(found, [0.5] * 3, "Is the BRDF base_color / pi, and each sample divided by its density?")

    def test_white_is_as_bright_as_its_light_in_total(self) -> None:
        """White in uniform light and white that faces a sun are as bright as by quadrature: one of both to 0.3 %.

        Samplers of directions have little noise in the one, samplers of light in the other.
        """
        sun, direction = scenes.sun(32, 64), scenes.sun_direction(32, 64)
        square, view = scenes.square(tuple(direction)), scenes.spot_view((0.0, 0.0, 0.0), tuple(direction), sun)
        cases: list[Inputs] = [_facing(scenes.constant_light()), (square, WHITE, view)]
        truth = [1.0, float(expected((square, WHITE, dataclasses.replace(view, width=1, height=1)))[0, 0])]
        slack = _PRECISE if self.capabilities.stochastic else self.slack
        message = "White in uniform light, and in a sun."
        self.check_values(self.brightnesses(*cases, spp=256), truth, message, slack)

    def test_a_convex_body_does_not_shadow_itself(self) -> None:
        """A white box is as bright as a white plane, at any size and place."""
        light, camera = scenes.constant_light(), np.array([1.5, 1.2, 1.8])
        cases: list[Inputs] = [_facing(light)]
        for size, away in ((1.0, 0.0), (0.01, 0.0), (100.0, 0.0), (1.0, 50.0)):
            origin, target = away + size * camera, (away + 0.0,) * 3
            view = View(Camera(_vector(origin), target, vertical_fov=0.3), light, 8, 8)
            cases.append((scenes.box(size, target), WHITE, view))
        message = "A convex body's points see half of the sky. Do rays start inside, and meet the face that they leave?"
        self.check_ratios(self.brightnesses(*cases, spp=16), np.ones(len(cases)), message)

    def test_a_surface_darkens_with_the_cosine(self) -> None:
        """Under one small sun a surface shines by the cosine and the sun's size."""
        light, tilts = scenes.row_lights(0, -1, rows=32), np.radians([0.0, 30.0, 50.0, 70.0, 88.0])
        cases = [
            _spot(scenes.square(normal), normal, light) for normal in ((0.0, math.cos(t), math.sin(t)) for t in tilts)
        ]
        cases.append(_facing(scenes.constant_light()))
        truth = expected(*cases).mean(axis=-1)
        message = "Tilted by 0, 30, 50, 70 and 88 degrees, and a plane in uniform light; shares of their sum."
        self.check_ratios(self.brightnesses(*cases), truth, message)

    def test_a_lid_casts_a_shadow_and_only_there(self) -> None:
        """A lid in the sun of noon casts a shadow, and only beneath itself."""
        light = scenes.row_lights(0, -1, rows=64)
        lid = scenes.quad((0.0, 0.5, 1.0), (1.0, 0.0, 0.0), (0.0, 0.0, -2.0))
        both, grey = scenes.joined(scenes.floor(2.0), lid), scenes.lambertian((0.1, 0.1, 0.1))  # so dark that what
        materials = Materials(grey.parts * 2)  # bounces between floor and lid is less than a hundredth
        views = [scenes.spot_view((x, 0.0, 0.0), UP, light, 0.25) for x in (-0.5, 0.5)]
        runs = self.brightnesses(*((both, materials, view) for view in views), (scenes.floor(2.0), grey, views[0]))
        lit, dark, open_sky = runs.mean(axis=0)
        check(open_sky > 0.0, "The floor is black under the sun of noon even without a lid.")
        check(dark < 0.01 * open_sky, f"Beneath the lid is {dark / open_sky:.3g} of the light: it casts no shadow.")
        self.check_ratios(runs[:, [0, 2]], [1.0, 1.0], f"The lid darkens what lies beside it ({lit:.4g}).")

    def test_seven_times_the_light_is_seven_times_as_bright(self) -> None:
        """Pictures are linear in the light: in a millionth of it, and in a million times as much."""
        one, other = scenes.random_light(seed=1), scenes.random_light(seed=2)
        times = (7.0, 1e-6, 1e6)
        lights = [one.radiance, other.radiance, one.radiance + other.radiance, *(n * one.radiance for n in times)]
        runs = self.radiances(*(_facing(Environment(light)) for light in lights), spp=64)
        a, b, both, *more = np.moveaxis(runs, 1, 0)
        for factor, bright in zip(times, more, strict=True):
            excess = 1.0 + (bright / factor - a) / a.mean()
            message = f"The picture in {factor:g} times the light, by {factor:g} times that in the light itself."
            self.check_values(excess, np.ones(3), message)
        sums = 1.0 + (both - a - b) / both.mean()
        self.check_values(sums, np.ones(3), "The picture in two lights together, by the sum of those in each.")

    def test_direct_light_is_linear_in_the_texture(self) -> None:
        """With the same seed, a sum of textures makes the sum of their pictures."""
        one, other = scenes.random_texture(5, 7, seed=1), scenes.random_texture(5, 7, seed=2)
        prepared, view = self.renderer.prepare(scenes.plane(2.0)), _filled(scenes.random_light())
        a, b, both = (
            self.renderer.render(prepared, scenes.lambertian(texture), view, spp=16, seed=3).image.double()
            for texture in (one, other, one + other)
        )
        off = float((a + b - both).abs().max() / both.max())
        check(off < 1e-5, f"The picture of a sum of two textures is off by {off:.2g} of its maximum.")

    def test_no_light_is_black(self) -> None:
        """Without light the picture is black, and covered all the same."""
        rendering = self.render(scenes.plane(2.0), WHITE, _filled(scenes.constant_light(0.0)))
        check_zero(rendering.image.cpu().numpy(), "There is no light.")
        check(bool((rendering.coverage > 0.999).all()), "In the dark, what fills the film must still cover it.")

    def test_black_is_black(self) -> None:
        """A black texture is black in any light."""
        black = scenes.lambertian(torch.zeros(3, 2, 3))
        rendering = self.render(scenes.plane(2.0), black, _filled(scenes.random_light()))
        check_zero(rendering.image.cpu().numpy(), "The texture is black.")

    def test_channels_do_not_mix(self) -> None:
        """Light and texture of one channel make a picture of that channel alone."""
        for channel, colour in enumerate(torch.eye(3)):
            others = [c for c in range(3) if c != channel]
            view = _filled(Environment(scenes.random_light().radiance * colour))
            for lit, material in (
                (view, WHITE),
                (_filled(scenes.random_light()), scenes.lambertian(colour.expand(2, 2, 3))),
            ):
                image = self.render(scenes.plane(2.0), material, lit).image.cpu().numpy()
                check(image[..., channel].max() > 0.0, f"Channel {channel} has light and colour, and is black.")
                check_zero(image[..., others], f"Only channel {channel} has light and colour.")

    def test_coverage_is_the_share_of_the_pixel(self) -> None:
        """Coverage is the share of a pixel that is surface: a box filter."""
        coverage, _ = _edged_square(self)
        top, bottom, left, right = coverage[:, 0], coverage[:, -1], coverage[:, :, 0], coverage[:, :, -1]
        sides = [side[:, 1:-1].mean(axis=1) for side in (top, bottom, left, right)]
        corners = coverage[:, ::7, ::7].mean(axis=(1, 2))
        message = "Of a square that reaches 0.3 into the pixels at its border: top, bottom, left, right, corners."
        self.check_values(np.stack([*sides, corners], axis=1), [0.3, 0.3, 0.3, 0.3, 0.09], message)
        check(bool((coverage[:, 1:-1, 1:-1] > 0.999).all()), "Inside, the square must cover the pixels whole.")

    def test_pictures_are_multiplied_by_coverage(self) -> None:
        """The image is multiplied by coverage: half covered is half as bright."""
        _, image = _edged_square(self)
        sides = [image[:, 0, 1:-1], image[:, -1, 1:-1], image[:, 1:-1, 0], image[:, 1:-1, -1]]
        inside = image[:, 1:-1, 1:-1].mean(axis=(1, 2))
        share = np.concatenate(sides, axis=1).mean(axis=1) / inside
        self.check_values(share, np.full((), 0.3), "Pixels of which 0.3 is surface, by whole ones.")

    def test_distance_does_not_darken(self) -> None:
        """A plane is as bright from afar as from nearby."""
        light = scenes.constant_light()
        distances = (0.5, 2.0, 8.0, 1000.0)
        views = [scenes.front_view(light, away, 8, 8, 2.0 * math.atan(0.4 / max(away, 8.0))) for away in distances]
        runs = self.brightnesses(*((scenes.plane(2.0), WHITE, view) for view in views))
        self.check_ratios(runs, np.ones(4), f"Seen from {distances} m.")

    def test_an_environment_of_any_size_lights_alike(self) -> None:
        """Uniform light is the same in 1 x 1 pixels and in many."""
        sizes = ((4, 8), (1, 1), (1, 5), (3, 1), (2, 2), (7, 9), (64, 128))
        cases = [_facing(scenes.constant_light(1.0, *size)) for size in sizes]
        self.check_ratios(self.brightnesses(*cases, spp=64), np.ones(len(sizes)), f"Rows and columns {sizes}.")

    def test_textures_are_looked_up_bilinearly(self) -> None:
        """Textures are bilinear between texel centres, at (i + 0.5) / n."""
        texture = torch.zeros(3, 3, 3)
        texture[1, 1] = 1.0
        points = [(1 / 2, 1 / 2), (2 / 3, 1 / 2), (1 / 2, 1 / 3), (7 / 12, 5 / 12), (5 / 6, 1 / 2), (1 / 2, 1 / 6)]
        truth = [1.0, 0.5, 0.5, 0.5625, 0.0, 0.0]
        found = [_texture_at(self, texture, u, v) for u, v in points]
        off = float(np.abs(np.subtract(found, truth)).max())
        message = (
            f"One white texel in the middle of 3 x 3, at (u, v) = {[(round(u, 3), round(v, 3)) for u, v in points]}"
        )
        check(off < 0.02, f"{message}: found {np.round(found, 3).tolist()}, wanted {truth}.")

    def test_textures_are_clamped_at_the_border(self) -> None:
        """Beyond the centres of its outermost texels a texture stays as it is."""
        found = _steps(self, (False, False))
        check(
            min(found) > 0.95, f"From edge to edge a texture of black and white spans {found} in u and v; wanted 1, 1."
        )

    def test_textures_repeat_where_the_surface_says(self) -> None:
        """Textures repeat along the axes that the surface names, and only there."""
        for repeat in ((True, False), (False, True), (True, True)):
            found, truth = _steps(self, repeat), [0.0 if axis else 1.0 for axis in repeat]
            message = f"With repeat {repeat}, a texture of black and white spans {found} in u and v; wanted {truth}."
            check(bool(np.allclose(found, truth, atol=0.05)), message)

    def test_light_bounces_as_often_as_declared(self) -> None:
        """In a grey bowl light is the geometric series of `max_bounces` terms."""
        bounces = self.capabilities.max_bounces
        declared(bounces > 1, "interreflection")
        light, grey = scenes.constant_light(), scenes.lambertian((0.8, 0.8, 0.8))
        outward = scenes.bowl(
            16, 32
        )  # from any of a sphere's points half of its cosine-weighted view is the lower half
        inward = dataclasses.replace(outward, faces=outward.faces[:, ::-1].copy(), normals=-outward.normals)
        inside = View(Camera((0.0, 0.0, 0.0), (0.0, -1.0, 0.2), vertical_fov=1.0), light, 8, 8)
        runs = self.brightnesses((inward, grey, inside), _facing(light))
        truth = [sum(0.4**k for k in range(1, bounces + 1)), 1.0]
        self.check_ratios(runs, truth, f"A bowl of base colour 0.8 and max_bounces {bounces}, beside a white plane.")

    def test_direct_light_takes_no_colour_from_other_parts(self) -> None:
        """With `max_bounces` 1, white beside red stays white."""
        declared(self.capabilities.max_bounces == 1, "direct light alone")
        materials = scenes.lambertian((0.8, 0.8, 0.8), (0.8, 0.0, 0.0), (0.8, 0.8, 0.8))
        view = scenes.spot_view((0.1, 0.0, 0.5), UP, scenes.constant_light())
        image = self.render(scenes.corner_box(), materials, view).image
        red, green = (float(image[..., channel].sum()) for channel in (0, 1))
        check(
            math.isclose(red, green, rel_tol=1e-4),
            f"White beside red has {red / max(green, 1e-12):.4f} of red to green.",
        )


def _edged_square(kit: MeasuredKit) -> tuple[Brightnesses, Brightnesses]:
    """Coverage and image (runs, 8, 8) of a square that fills the inner pixels, and 0.3 of those at the border."""
    view = scenes.front_view(scenes.constant_light(), 1.0, 8, 8, 2.0 * math.atan(0.5 * 8.0 / 6.6))
    pictures = [picture for (picture,) in kit.pictures((scenes.plane(1.0), WHITE, view), spp=64)]
    coverage = torch.stack([picture.coverage for picture in pictures])
    image = torch.stack([picture.image.mean(dim=-1) for picture in pictures])
    return numbers(coverage), numbers(image)


def _steps(kit: MeasuredKit, repeat: tuple[bool, bool]) -> list[float]:
    """The steps of a texture of two texels, black and white, from one edge to the other, in u and in v."""
    across = torch.tensor([0.0, 1.0])[None, :, None].expand(2, 2, 3)
    ends = [[(0.001, 0.5), (0.999, 0.5)], [(0.5, 0.001), (0.5, 0.999)]]
    values = [
        [_texture_at(kit, texture, u, v, repeat) for u, v in pair]
        for texture, pair in zip((across, across.transpose(0, 1)), ends, strict=True)
    ]
    return [round(abs(first - last), 3) for first, last in values]


def _texture_at(
    kit: MeasuredKit,
    texture: Float[Tensor, "rows cols 3"],
    u: float,
    v: float,
    repeat: tuple[bool, bool] = (False, False),
) -> float:
    """The texture's value at a point of the plane: what is seen of it, by what is seen of white."""
    prepared = kit.renderer.prepare(dataclasses.replace(scenes.plane(), repeat=repeat))
    view = scenes.spot_view((u - 0.5, v - 0.5, 0.0), FRONT, scenes.constant_light(), extent=0.001)
    seen, white = (
        float(kit.renderer.render(prepared, material, view, spp=16, seed=5).image.mean())
        for material in (scenes.lambertian(texture), WHITE)
    )
    return seen / white if white > 0.0 else math.nan


def _facing(light: Environment) -> Inputs:
    return scenes.plane(2.0), WHITE, _filled(light)


def _filled(light: Environment) -> View:
    """A view of nothing but `plane(2)`."""
    return scenes.front_view(light, 1.0, 8, 8, 0.5)


def _spot(surface: Surface, normal: tuple[float, float, float], light: Environment) -> Inputs:
    return surface, WHITE, scenes.spot_view((0.0, 0.0, 0.0), normal, light)


def _vector(point: np.ndarray) -> tuple[float, float, float]:
    x, y, z = point
    return float(x), float(y), float(z)
