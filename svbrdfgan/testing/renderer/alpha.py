"""Parts that rays pass through, where `alpha` is declared; where it is not, they are opaque."""

from __future__ import annotations

import numpy as np

from svbrdfgan.testing import scenes
from svbrdfgan.testing.kit import check, declared
from svbrdfgan.testing.renderer.brightness import Inputs, MeasuredKit, expected
from svbrdfgan.testing.statistics import numbers
from svbrdfgan.types import Camera, Materials, Surface, View

FRONT = (0.0, 0.0, 1.0)


class AlphaTests(MeasuredKit):
    """Coverage, what lies behind, shadow, and several bounces."""

    def test_without_alpha_parts_are_opaque(self) -> None:
        """Where `alpha` is not declared, every part covers all that lies behind it."""
        declared(not self.capabilities.alpha, "lacking alpha")
        coverage = self.render(scenes.with_alpha(scenes.plane(2.0), 0.3), WHITE, _filled(), spp=4).coverage
        check(float(coverage.min()) > 0.999, f"A part of alpha 0.3 covers {float(coverage.min()):.3f} of a pixel.")

    def test_coverage_of_a_clear_part_is_its_alpha(self) -> None:
        """Alone, a part covers, and is as bright as, the share of rays that its alpha stops."""
        _declares(self)
        surfaces = [scenes.with_alpha(scenes.plane(2.0), alpha) for alpha in (0.0, 0.3, 0.8, 1.0)]
        runs = self.pictures(*((surface, WHITE, _filled()) for surface in surfaces), spp=64)
        coverage = np.array([[numbers(picture.coverage).mean() for picture in run] for run in runs])
        self.check_values(coverage, [0.0, 0.3, 0.8, 1.0], "Coverage of parts of alpha 0, 0.3, 0.8 and 1.")
        check(not coverage[:, 0].any(), "A part of alpha 0 covers something.")
        image = np.array([[numbers(picture.image).mean() for picture in run] for run in runs])
        self.check_ratios(image, [0.0, 0.3, 0.8, 1.0], "The image of parts of alpha 0, 0.3, 0.8 and 1.")

    def test_a_clear_part_shows_what_is_behind(self) -> None:
        """Behind a part is seen what its alpha leaves, neither bent nor tinted."""
        _declares(self)
        layers = scenes.joined(scenes.plane(2.0), _behind(0.5), _behind(1.0))
        colors, surface = scenes.lambertian((0.8, 0.0, 0.0), (0.0, 0.8, 0.0), (0.2, 0.2, 0.8)), scenes.with_alpha
        alphas = (0.4, 0.5, 1.0), (0.0, 0.3, 1.0), (0.2, 1.0, 0.7), (1.0, 0.5, 0.5)
        view = scenes.front_view(scenes.row_lights(7, 8), 1.0, 4, 4, 0.4)
        cases: list[Inputs] = [(surface(layers, *each), colors, view) for each in alphas]
        runs = self.radiances(*cases, spp=64)
        message = f"Red, green and blue sheets behind one another with alpha {alphas}, red, green, blue of each."
        self.check_ratios(runs.reshape(len(runs), -1), expected(*cases, split=4).reshape(-1), message)

    def test_alpha_lies_as_textures(self) -> None:
        """Texels of alpha lie where those of a base colour would, and are looked up bilinearly."""
        _declares(self)
        surface = scenes.with_alpha(scenes.plane(), np.array([[0.1, 0.3], [0.6, 1.0]]))
        spots = [(x, y, 0.0) for y in (-0.25, 0.25) for x in (-0.25, 0.25)] + [(0.0, 0.0, 0.0)]
        views = [scenes.spot_view(spot, FRONT, scenes.constant_light()) for spot in spots]
        runs = self.pictures(*((surface, WHITE, view) for view in views), spp=64)
        coverage = np.array([[numbers(picture.coverage).mean() for picture in run] for run in runs])
        message = "Coverage at texels (0, 0), (0, 1), (1, 0), (1, 1), and between them."
        self.check_values(coverage, [0.1, 0.3, 0.6, 1.0, 0.5], message)

    def test_a_clear_lid_casts_a_part_of_a_shadow(self) -> None:
        """Light passes a lid by what its alpha leaves, and takes nothing of its colour."""
        _declares(self)
        declared(self.capabilities.max_bounces == 1, "direct light alone")
        alphas, colors = (0.0, 0.3, 0.8, np.array([[0.5]])), scenes.lambertian((0.5, 0.5, 0.5), (0.9, 0.1, 0.1))
        view = View(Camera((0.5, 0.2, 0.0), (0.5, 0.0, 0.0), (0.0, 0.0, -1.0), 0.1), scenes.row_lights(0), 4, 4)
        cases: list[Inputs] = [(scenes.with_alpha(scenes.occluder(), 1.0, alpha), colors, view) for alpha in alphas]
        runs = self.radiances(*cases, spp=64)
        truth = np.repeat([1.0, 0.7, 0.2, 0.5], 3)
        message = "Under lids of alpha 0, 0.3, 0.8 and 0.5; red, green, blue of each."
        self.check_ratios(runs.reshape(len(runs), -1), truth, message)

    def test_two_clear_lids_cast_the_product(self) -> None:
        """Light that passes several parts keeps the product of what each leaves."""
        _declares(self)
        declared(self.capabilities.max_bounces == 1, "direct light alone")
        higher = scenes.quad((0.0, 0.8, 1.0), (1.0, 0.0, 0.0), (0.0, 0.0, -2.0))
        lids = scenes.joined(scenes.occluder(), higher)
        view = View(Camera((0.5, 0.2, 0.0), (0.5, 0.0, 0.0), (0.0, 0.0, -1.0), 0.1), scenes.row_lights(0), 4, 4)
        colors = Materials(WHITE.parts * 3)
        alphas = (0.0, 0.0), (0.5, 0.0), (0.5, 0.5)
        cases: list[Inputs] = [(scenes.with_alpha(lids, 1.0, *each), colors, view) for each in alphas]
        self.check_ratios(self.brightnesses(*cases, spp=64), [1.0, 0.5, 0.25], f"Under lids of alpha {alphas}.")

    def test_paths_pass_what_is_not_there(self) -> None:
        """A part of alpha 0 between others changes nothing, with as many bounces as declared."""
        _declares(self)
        box = scenes.corner_box()
        screen = scenes.quad((0.4, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 1.0, 0.0))
        view, black = scenes.corner_view(scenes.constant_light(), 4, 4), scenes.lambertian((0.0, 0.0, 0.0))
        hidden: Surface = scenes.with_alpha(scenes.joined(box, screen), 1.0, 1.0, 1.0, 0.0)
        cases: list[Inputs] = [
            (box, Materials(WHITE.parts * 3), view),
            (hidden, Materials((*WHITE.parts * 3, *black.parts)), view),
        ]
        runs = self.brightnesses(*cases, spp=64)
        self.check_ratios(runs, [1.0, 1.0], "The corner of a room, and with a black screen of alpha 0 in it.")


WHITE = scenes.lambertian((1.0, 1.0, 1.0))


def _declares(kit: MeasuredKit) -> None:
    declared(kit.capabilities.alpha, "alpha")


def _filled() -> View:
    """A view of nothing but `plane(2)`."""
    return scenes.front_view(scenes.constant_light(), 1.0, 4, 4, 0.5)


def _behind(depth: float) -> Surface:
    return scenes.quad((-2.0, -2.0, -depth), (4.0, 0.0, 0.0), (0.0, 4.0, 0.0))
