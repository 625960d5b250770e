"""Directions and orders of axes. These tests compare brightnesses, and state none."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan.testing import scenes
from svbrdfgan.testing.kit import check
from svbrdfgan.testing.renderer.brightness import Inputs, MeasuredKit, expected
from svbrdfgan.testing.statistics import numbers
from svbrdfgan.types import Camera, Environment, Rendering, View

WHITE = scenes.lambertian((1.0, 1.0, 1.0))
FRONT = (0.0, 0.0, 1.0)
AXES = np.concatenate([np.eye(3), -np.eye(3)])
_SIDES = "+X, +Z, -X, -Z"


class OrientationTests(MeasuredKit):
    """Picture, camera, environment, textures, normals, parts."""

    def test_row_0_of_the_picture_is_its_top(self) -> None:
        """What is higher (+Y) is in a lower row of image and coverage."""
        for what, (row, _) in _where(self, 0.0, 0.5).items():
            check(row < 3.0, f"{what}: what is above the middle is in row {row:.1f} of 0 to 7; is it upside down?")

    def test_right_is_right(self) -> None:
        """What is to the right (+X) is in a higher column of image and coverage."""
        for what, (_, col) in _where(self, 0.5, 0.0).items():
            check(col > 4.0, f"{what}: what is right of the middle is in column {col:.1f} of 0 to 7; is it mirrored?")

    def test_up_is_what_the_camera_says(self) -> None:
        """The camera's `up` turns the picture: with +X up, +X is on top."""
        above = _where(self, 0.0, 0.5)  # wherever that is: the same place is wanted, turned with the camera
        turned = {"+X": _where(self, 0.5, 0.0, (1.0, 0.0, 0.0)), "-Y": _where(self, 0.0, -0.5, (0.0, -1.0, 0.0))}
        # `up` need not be perpendicular to the line of sight
        turned["+X and -Y"] = _where(self, math.sqrt(0.125), -math.sqrt(0.125), (1.0, -1.0, 0.4))
        for up, places in turned.items():
            for what, (row, col) in places.items():
                near = math.hypot(row - above[what][0], col - above[what][1]) < 0.5
                place = f"what lies there is at row {row:.1f}, column {col:.1f} of 0 to 7"
                check(near, f"{what}: with `up` towards {up}, {place}; wanted it where +Y is by default.")

    def test_the_camera_looks_at_its_target(self) -> None:
        """From anywhere, the camera's target is in the middle of the picture."""
        spot = scenes.box(0.2, (1.0, 2.0, 3.0))
        for origin in ((4.0, 3.0, 1.0), (-2.0, 2.5, 2.0), (1.0, -1.0, 3.5)):
            view = View(Camera(origin, (1.0, 2.0, 3.0), vertical_fov=0.5), scenes.constant_light(), 9, 9)
            row, col = _centre(numbers(self.render(spot, WHITE, view).image).sum(axis=-1))
            check(
                abs(row - 4.0) < 0.3 and abs(col - 4.0) < 0.3,
                f"From {origin} the target is at row {row:.2f}, column {col:.2f}; wanted 4, 4.",
            )

    def test_the_field_of_view_is_vertical(self) -> None:
        """`vertical_fov` is the full angle over the height; pixels are square."""
        fov = 2.0 * math.atan(0.5)  # shows 1 m at a distance of 1 m
        for width, height in ((12, 12), (24, 12), (12, 24)):
            view = scenes.front_view(scenes.constant_light(), 1.0, width, height, fov)
            image = numbers(self.render(scenes.plane(0.5), WHITE, view, spp=64).image).sum(axis=-1)
            shown = image / image.max() > 0.4
            found = shown.sum(axis=0).max(), shown.sum(axis=1).max()
            message = f"On {width} x {height} pixels, half of the height is {found[0]} rows and {found[1]} columns"
            check(found == (height // 2, height // 2), f"{message}; wanted {height // 2} of both.")

    def test_texture_row_0_is_at_the_bottom(self) -> None:
        """Texel (row, col) lies at ((col + 0.5) / cols, (row + 0.5) / rows)."""
        texture = torch.tensor([[0.1, 0.2], [0.4, 0.8]])[..., None].expand(2, 2, 3)
        places = [
            scenes.spot_view((x, y, 0.0), FRONT, scenes.constant_light()) for y in (-0.25, 0.25) for x in (-0.25, 0.25)
        ]
        cases = [(scenes.plane(), scenes.lambertian(texture), view) for view in places]
        order = "lower left, lower right, upper left, upper right; is the texture upside down, mirrored or transposed?"
        message = f"Texels (0, 0), (0, 1), (1, 0), (1, 1) at the {order}"
        self.check_ratios(self.brightnesses(*cases), expected(*cases).mean(axis=-1), message)

    def test_textures_lie_by_uv(self) -> None:
        """Where a surface's UVs are turned and cut out, so is its texture."""
        plane, light = scenes.plane(), scenes.constant_light()
        uv = np.array([[0.75, 0.25], [0.75, 0.75], [0.25, 0.75], [0.25, 0.25]])  # a quarter turn, the middle half
        texture = scenes.lambertian(torch.tensor([[0.1, 0.2], [0.4, 0.8]])[..., None].expand(2, 2, 3))
        turned = dataclasses.replace(plane, uv=0.98 * (uv - 0.5) + 0.5)
        corners = [scenes.spot_view(0.98 * position, FRONT, light) for position in plane.positions]
        places = [scenes.spot_view((u - 0.5, v - 0.5, 0.0), FRONT, light) for u, v in 0.98**2 * (uv - 0.5) + 0.5]
        cases = [(turned, texture, view) for view in corners] + [(plane, texture, view) for view in places]
        found, wanted = np.split(self.brightnesses(*cases), 2, axis=1)
        excess = 1.0 + (found - wanted) / wanted.mean()
        self.check_values(
            excess, np.ones(4), "Corners of a plane with its UVs turned, less the plain one at those UVs."
        )

    def test_columns_of_the_environment_go_round(self) -> None:
        """The middle column lights from -Z, three quarters from +X, the ends +Z."""
        _check_lights(
            self, [(4, col) for col in (1, 3, 4, 7, 8, 11, 12, 14)], rows=8, cols=16, normals=AXES[[0, 2, 3, 5]]
        )

    def test_row_0_of_the_environment_is_the_zenith(self) -> None:
        """Row i of the environment lights from (i + 0.5) / rows * pi below +Y."""
        normals = (AXES[1], AXES[4], (0.0, 0.6, 0.8), (0.0, -0.6, 0.8))
        rows = (0, 1, 3, 6, 7)
        cases = [_lit(normal, scenes.row_lights(row, rows=8)) for row in rows for normal in normals]
        faces = "what faces up, down, above and below the horizon"
        message = f"Rows {rows} of 8, each on {faces}; is the light upside down, or less at a pole?"
        self.check_ratios(self.brightnesses(*cases), expected(*cases).mean(axis=-1), message)

    def test_the_environment_has_no_seam(self) -> None:
        """The first and last column are neighbours: light passes between them."""
        normals = [n for n in AXES if n[1] == 0.0]  # one of them sees nothing but what is beyond the seam
        for col in (0, 3):
            there = [_lit(normal, scenes.sun(4, col, 8, 4)) for normal in normals]
            opposite = [_lit(-normal, scenes.sun(4, col ^ 2, 8, 4)) for normal in normals]
            found, wanted = np.split(self.brightnesses(*there, *opposite, spp=64), 2, axis=1)
            excess = 1.0 + (found - wanted) / wanted.mean()
            message = f"Column {col} of 4 on what faces {_SIDES}, less column {col ^ 2} on the opposite, by their mean."
            self.check_values(excess, np.ones(4), f"{message} Is light lost at the seam, or bent?")

    def test_rotation_turns_the_light_counter_clockwise(self) -> None:
        """Rotation turns the light about +Y counter-clockwise, by radians."""
        for angle in (math.pi / 2.0, 0.7, -2.5):
            c, s = math.cos(angle), math.sin(angle)
            turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
            normals = [n for n in AXES if n[1] == 0.0]
            radiance = scenes.sun(8, 21, 16, 32).radiance  # neither on an axis nor on a diagonal
            still = [_lit(normal, Environment(radiance)) for normal in normals]
            moved = [_lit(turn @ normal, Environment(radiance, angle)) for normal in normals]
            runs = self.brightnesses(*still, *moved)
            before, after = (half / half.mean(axis=0).sum() for half in np.split(runs, 2, axis=1))
            message = f"With rotation {angle:.2f}, excess on surfaces turned likewise; is its sense or unit another?"
            self.check_values(1.0 + after - before, np.ones(len(normals)), message)

    def test_surfaces_have_two_sides(self) -> None:
        """A plane looks the same whether it faces the camera or away."""
        surface, light = scenes.plane(2.0), scenes.constant_light()
        view = scenes.front_view(light, 1.0, 4, 4, 0.5)
        away = dataclasses.replace(surface, faces=surface.faces[:, ::-1].copy(), normals=-surface.normals)
        runs = self.brightnesses((surface, WHITE, view), (away, WHITE, view), spp=64)
        self.check_ratios(runs, [1.0, 1.0], "A plane that faces the camera, and one that faces away.")

    def test_winding_does_not_matter(self) -> None:
        """A plane looks the same whichever way its triangles wind."""
        surface, view = scenes.plane(2.0), scenes.front_view(scenes.constant_light(), 1.0, 4, 4, 0.5)
        rewound = dataclasses.replace(surface, faces=surface.faces[:, ::-1].copy())
        runs = self.brightnesses((surface, WHITE, view), (rewound, WHITE, view), spp=64)
        self.check_ratios(runs, [1.0, 1.0], "Triangles counter-clockwise and clockwise, with the same shading normals.")

    def test_light_does_not_shine_through(self) -> None:
        """A floor is lit on the side from which it is seen, and not through it."""
        light = scenes.row_lights(0, rows=8)
        views = [scenes.spot_view((0.0, 0.0, 0.0), (0.0, y, 0.0), light) for y in (1.0, -1.0)]
        above, below = self.brightnesses(*((scenes.floor(), WHITE, view) for view in views), runs=2).mean(axis=0)
        bright, dark = max(above, below), min(above, below)
        check(
            bright > 0.0 and dark == 0.0,
            f"In light from above, a floor is {above:.3g} seen from above, {below:.3g} from below; wanted none of one.",
        )

    def test_shading_normals_shade(self) -> None:
        """Shading normals that lean to the light brighten a flat plane."""
        light, plane = scenes.row_lights(0, -1, rows=16), scenes.plane()
        normals = [(0.0, y, math.sqrt(1.0 - y * y)) for y in (0.3, 0.6, 0.8)]
        leaning = [dataclasses.replace(plane, normals=np.tile(normal, (4, 1))) for normal in normals]
        cases = [(surface, WHITE, scenes.spot_view((0.0, 0.0, 0.0), FRONT, light)) for surface in leaning]
        message = "Shading normals that lean to the sun by 0.3, 0.6 and 0.8; are the geometric ones used?"
        self.check_ratios(self.brightnesses(*cases), expected(*cases).mean(axis=-1), message)

    def test_shading_normals_are_interpolated(self) -> None:
        """Between vertices the shading normal turns, and keeps its length."""
        light, plane = scenes.row_lights(0, -1, rows=16), scenes.plane()
        lean = np.where(plane.positions[:, 1:2] > 0.0, 1.0, -1.0) * np.array([0.0, 0.8, 0.0])
        bent = dataclasses.replace(plane, normals=lean + np.array([0.0, 0.0, 0.6]))
        spots = [scenes.spot_view((0.2, y, 0.0), FRONT, light) for y in (-0.4, -0.1, 0.0, 0.25)]
        cases = [(bent, WHITE, view) for view in spots]
        message = "Four points of a plane whose normals turn from the bottom, downwards, to the top, upwards."
        self.check_ratios(self.brightnesses(*cases), expected(*cases).mean(axis=-1), message)

    def test_each_part_has_its_own_material(self) -> None:
        """Part i is made of material i, in whatever order its triangles come."""
        colors = torch.eye(3)[[0, 1, 2, 1, 0]] * torch.tensor([1.0, 0.8, 0.6, 0.4, 0.2])[:, None]
        strips = [scenes.quad((0.2 * i - 0.5, -0.5, 0.0), (0.2, 0.0, 0.0), (0.0, 1.0, 0.0)) for i in range(5)]
        maps = [color if i % 2 else color.expand(i + 1, 2, 3) for i, color in enumerate(colors)]
        surface = scenes.shuffled(scenes.joined(*strips), seed=2)
        light = scenes.constant_light()
        views = [scenes.spot_view((0.2 * i - 0.4, 0.0, 0.0), FRONT, light) for i in range(5)]
        runs = self.radiances(*((surface, scenes.lambertian(*maps), view) for view in views))
        message = "Five strips, red, green, blue, green, red, one after the other; which part has whose material?"
        self.check_ratios(runs.reshape(len(runs), -1), colors.reshape(-1).numpy(), message)


def _where(
    kit: MeasuredKit, x: float, y: float, up: tuple[float, float, float] = (0.0, 1.0, 0.0)
) -> dict[str, tuple[float, float]]:
    """Row and column of a small square at (x, y), in a picture of 2 x 2 m, by image and by coverage."""
    small = scenes.quad((x - 0.1, y - 0.1, 0.0), (0.2, 0.0, 0.0), (0.0, 0.2, 0.0))
    camera = Camera((0.0, 0.0, 2.0), up=up, vertical_fov=2.0 * math.atan(0.5))
    rendering: Rendering = kit.render(small, WHITE, View(camera, scenes.constant_light(), 8, 8))
    films = {"image": numbers(rendering.image).sum(axis=-1), "coverage": numbers(rendering.coverage)}
    varying = {what: _centre(film - film.min()) for what, film in films.items() if film.max() > film.min()}
    check(bool(varying), "nothing is seen of a small square in the middle of the view's field.")
    return varying


def _check_lights(
    kit: MeasuredKit, pixels: list[tuple[int, int]], rows: int, cols: int, normals: Float[ndarray, "normals 3"]
) -> None:
    """Each pixel of an environment, lit alone, lights surfaces of some normals as it should."""
    for row, col in pixels:
        cases = [_lit(normal, scenes.sun(row, col, rows, cols)) for normal in normals]
        message = f"Pixel ({row}, {col}) of {rows} x {cols} on what faces {_SIDES}; is the light mirrored?"
        kit.check_ratios(kit.brightnesses(*cases), expected(*cases).mean(axis=-1), message)


def _lit(normal: Float[ndarray, 3] | tuple[float, float, float], light: Environment) -> Inputs:
    return scenes.square(tuple(normal)), WHITE, scenes.spot_view((0.0, 0.0, 0.0), tuple(normal), light)


def _centre(film: Float[ndarray, "height width"]) -> tuple[float, float]:
    """Row and column of the centre of what is not zero; not a number where all is."""
    rows, cols = np.indices(film.shape)
    with np.errstate(invalid="ignore"):
        return float((rows * film).sum() / film.sum()), float((cols * film).sum() / film.sum())
