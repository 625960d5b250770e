"""Small shares of pixels, grazing angles, near occluders, and small changes of maps: where thresholds of others lie."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import torch

from svbrdfgan.testing import scenes
from svbrdfgan.testing.kit import check
from svbrdfgan.testing.renderer.brightness import Inputs, MeasuredKit
from svbrdfgan.testing.statistics import numbers
from svbrdfgan.types import CHANNELS, Camera, Materials, View

WHITE, BLACK = scenes.lambertian((1.0, 1.0, 1.0)), scenes.lambertian((0.0, 0.0, 0.0))
_SHARES = np.array([0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 0.95, 0.98, 0.6])
_LEVELS = (0.0, 0.002, 0.01, 0.05, 0.4, 0.401, 0.6, 0.601, 0.95, 0.99, 0.998, 1.0)


class ExtremeTests(MeasuredKit):
    """Thresholds below which a renderer might neglect something, or round it."""

    def test_grazing_views_are_as_bright(self) -> None:
        """White in uniform light has the same radiance from any side, down to 1.5 degrees above the plane."""
        degrees = (90.0, 15.0, 4.0, 1.5)
        toward = [(0.0, math.cos(angle), math.sin(angle)) for angle in np.radians(degrees)]
        light = scenes.constant_light()
        views = [scenes.spot_view((0.0, 0.0, 0.0), each, light, 0.5, 0.001) for each in toward]
        runs = self.brightnesses(*((scenes.plane(2.0), WHITE, view) for view in views), spp=64)
        self.check_ratios(runs, np.ones(len(views)), f"Seen {degrees} degrees above the plane.")

    def test_what_is_near_casts_a_shadow(self) -> None:
        """A wall on a floor casts a shadow on what lies 1, 3, 10 and 100 mm beside it."""
        light, floor = scenes.row_lights(3, 4, rows=16), scenes.floor(2.0)
        wall = scenes.quad((0.0, 0.0, 1.0), (0.0, 0.0, -2.0), (0.0, 1.0, 0.0))
        for away in (0.001, 0.003, 0.01, 0.1):
            view = scenes.spot_view((away, 0.0, 0.0), (0.0, 1.0, 0.0), light, 0.5, 0.2 * away)
            cases: list[Inputs] = [(scenes.joined(floor, wall), Materials(WHITE.parts + BLACK.parts), view)]
            cases.append((floor, WHITE, view))
            shadowed, lit = self.brightnesses(*cases, spp=64).mean(axis=0)
            what = f"{1000 * away:g} mm beside a wall, under a ring of light, is {shadowed / lit:.3f} of all light"
            check(0.4 < shadowed / lit < 0.6, f"{what}; wanted half. Do rays start too far from the surface?")

    def test_coverage_of_slivers(self) -> None:
        """Coverage of a pixel is any share of it that is surface, from 2 % to 98 %: no threshold rounds it."""
        size, count = 1.0 / 8.0, len(_SHARES)
        strips = [
            scenes.quad(((i - count / 2) * size, -1.0, 0.0), (float(share) * size, 0.0, 0.0), (0.0, 2.0, 0.0))
            for i, share in enumerate(_SHARES)
        ]
        view = scenes.front_view(scenes.constant_light(), 1.0, count, 8, 2.0 * math.atan(0.5))
        inputs = scenes.joined(*strips), Materials(WHITE.parts * count), view
        runs = np.array([numbers(picture.coverage).mean(axis=0) for (picture,) in self.pictures(inputs, spp=128)])
        self.check_values(runs, _SHARES, "Coverage of pixels with strips of these shares.")

    def test_small_changes_of_maps_show(self) -> None:
        """Every map, in steps of 0.002 at its ends and of 0.001 in the middle, gives another picture."""
        view = View(Camera((0.5, 0.7, 0.8), vertical_fov=0.1), scenes.random_light(), 2, 2)
        prepared = self.renderer.prepare(scenes.plane())
        base = {"base_color": [0.5, 0.4, 0.3], "roughness": 0.4, "metallic": 0.4, "normal": [0.2, 0.1, 0.8]}
        known: dict[str, Any] = {name: base[name] for name in base if name in self.capabilities.maps}
        for name in known:
            levels = [level for level in _LEVELS if level > 0.05 or name != "roughness"]
            values = [[level, 0.1, 0.8] if name == "normal" else [level] * CHANNELS[name] for level in levels]
            each = [scenes.material(**{**known, name: value}) for value in values]
            images = [self.renderer.render(prepared, Materials((one,)), view, spp=16, seed=1).image for one in each]
            pairs = zip(pairwise(levels), pairwise(images), strict=True)
            same = [f"{one} and {other}" for (one, other), (a, b) in pairs if torch.equal(a, b)]
            check(not same, f"{name} gives the same picture at {', '.join(same)}.")
