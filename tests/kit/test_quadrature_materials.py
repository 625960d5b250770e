"""The kit's own sums of whole materials, tilted normals and parts that light passes, against closed forms."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan.testing import scenes
from svbrdfgan.testing.quadrature import Quadrature
from svbrdfgan.testing.rays import Points, seen
from svbrdfgan.testing.reflection import Shades, bent, reflected
from svbrdfgan.testing.renderer import cases
from svbrdfgan.testing.scenes import material, with_alpha
from svbrdfgan.types import Camera, Environment, Material, Materials, Surface, View

UP = np.array([0.0, 0.0, 1.0])
TILT = (0.6, 0.0, 0.8)


def _unit(*vector: float) -> Float[ndarray, 3]:
    return np.array(vector) / np.linalg.norm(vector)


def _point(to_viewer: Float[ndarray, 3]) -> Points:
    """A point of a surface that faces +Z, with its tangent along +X."""
    frame = UP, np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    rows = [each[None] for each in (*frame, to_viewer)]
    return Points(np.zeros(1, int), np.ones(1), np.zeros(1, int), np.zeros((1, 2)), np.zeros((1, 3)), *rows)


def _shades(roughness: float, metallic: float, normal: tuple[float, float, float] = (0.0, 0.0, 1.0)) -> Shades:
    values = [np.array([each]) for each in ((1.0, 1.0, 1.0), (roughness,), (metallic,), normal)]
    return Shades(np.array([True]), *values)


def _white(roughness: float, metallic: float, to_viewer: ndarray, direction: ndarray) -> Float[ndarray, " cells"]:
    """What white reflects, times the cosine."""
    by_color, alone = reflected(_point(to_viewer), _shades(roughness, metallic), np.atleast_2d(direction))
    return np.asarray((by_color + alone)[0])


def _seen(material: Material, view: View, surface: Surface | None = None, **fineness: int) -> Float[ndarray, "h w 3"]:
    surface = surface or scenes.plane(2.0)
    return Quadrature(
        surface, Materials((material,) * len(surface.parts)), view, **({"grid": 2, "split": 4} | fineness)
    ).image()


def _sheet(light: Environment, behind: bool = False) -> View:
    return View(Camera((0.0, 0.0, -3.0 if behind else 3.0), vertical_fov=0.2), light, 2, 2)


@pytest.mark.parametrize("cosine", [1.0, 0.6])
def test_a_white_metal_reflects_nearly_all_light(cosine: float) -> None:
    """Of roughness 0.3 less than 2 % is lost, to light that would be scattered between facets more than once."""
    azimuth, height = (np.indices((800, 800)).reshape(2, -1) + 0.5) / 800
    radius = np.sqrt(1.0 - height**2)
    sphere = np.stack([radius * np.cos(2 * np.pi * azimuth), radius * np.sin(2 * np.pi * azimuth), height], axis=-1)
    reflectance = _white(0.3, 1.0, _unit(math.sqrt(1.0 - cosine**2), 0.0, cosine), sphere).mean() * 2.0 * np.pi
    assert 0.98 < reflectance < 1.0005


@pytest.mark.parametrize("metallic", [0.0, 0.4, 1.0])
def test_reflection_is_reciprocal(metallic: float) -> None:
    """Light and viewer may be exchanged where the normal is not bent."""
    one, other = _unit(0.3, 0.2, 0.9), _unit(-0.8, 0.5, 0.4)
    there, back = _white(0.4, metallic, one, other) / other[2], _white(0.4, metallic, other, one) / one[2]
    assert there == pytest.approx(back)


def test_values_at_normal_incidence() -> None:
    """Of roughness 1, where D G / 4 is 1 / (4 pi): metals have their base colour as F0, and no diffuse term."""
    for metallic, slope, alone in ((0.0, 0.96 / math.pi, 0.01 / math.pi), (1.0, 0.25 / math.pi, 0.0)):
        by_color, rest = reflected(_point(UP), _shades(1.0, metallic), UP[None])
        assert float(by_color[0, 0]) == pytest.approx(slope)
        assert float(rest[0, 0]) == pytest.approx(alone, abs=1e-12)


def test_the_picture_is_linear_in_metallic() -> None:
    view = replace(cases.glossy(0.4).view, environment=cases.soft_light())
    none, some, all_ = (
        _seen(material(base_color=(0.7, 0.4, 0.2), roughness=0.4, metallic=m), view) for m in (0, 0.3, 1)
    )
    assert some == pytest.approx(0.7 * none + 0.3 * all_)
    assert abs(all_ - none).max() > 0.05


def test_a_neutral_normal_changes_nothing() -> None:
    """Whatever its length, also aslant and in textures."""
    view = cases.glossy(0.4, cases.soft_light()).view
    maps = {"base_color": (0.5, 0.3, 0.1), "roughness": 0.4, "metallic": 0.5}
    plain = _seen(material(**maps), view)
    for normal in ((0.0, 0.0, 1.0), (0.0, 0.0, 0.2), torch.tensor([0.0, 0.0, 3.0]).expand(2, 3, 3)):
        assert _seen(material(**maps, normal=normal), view) == pytest.approx(plain)


@pytest.mark.parametrize(("row", "col"), [(32, 100), (20, 110), (40, 20), (30, 70), (25, 60)])
@pytest.mark.parametrize(
    ("mirrored", "behind", "along_x"),
    [(False, False, 0.6), (True, False, -0.6), (False, True, -0.6), (True, True, 0.6)],
)
def test_a_tilted_normal_shades(row: int, col: int, mirrored: bool, behind: bool, along_x: float) -> None:
    """Lambert's cosine of a small sun to the tilted normal, which pushes through the sheet; in mirrored UVs, too."""
    surface, light = scenes.plane(2.0), scenes.sun(row, col)
    if mirrored:
        surface = replace(surface, uv=surface.uv * [-1.0, 1.0] + [1.0, 0.0])
    side = -1.0 if behind else 1.0
    normal, sun = np.array([along_x, 0.3, side * 0.8]), scenes.sun_direction(row, col)
    wanted = max(float(normal @ sun), 0.0) / np.linalg.norm(normal) if side * sun[2] > 0.0 else 0.0
    tilt = torch.tensor([0.6, -0.3 if behind else 0.3, 0.8])
    image = _seen(material(base_color=(1.0, 1.0, 1.0), normal=tilt), _sheet(light, behind), surface)
    assert image == pytest.approx(wanted, rel=5e-3, abs=1e-6)


def test_normals_are_looked_up_and_then_scaled() -> None:
    """Between texels (1, 0, 1) and (0, 0, 3) lies (0.5, 0, 2), whatever the lengths."""
    texels, light = torch.tensor([[[1.0, 0.0, 1.0], [0.0, 0.0, 3.0]]]), scenes.sun(32, 105)
    view = scenes.spot_view((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), light, extent=1e-4)
    found = _seen(material(base_color=(1.0, 1.0, 1.0), normal=texels), view)
    assert found == pytest.approx(float(_unit(0.5, 0.0, 2.0) @ scenes.sun_direction(32, 105)), rel=5e-3)


def test_a_bent_normal_mirrors_the_viewer_along_the_surface() -> None:
    """It lies between the tilted one and the viewer; where the mirror direction is above, nothing is bent."""
    generator = np.random.default_rng(3)
    tilted, to_viewer = generator.normal(size=(2, 2000, 3))
    tilted[:, 2], to_viewer[:, 2] = abs(tilted[:, 2]), abs(to_viewer[:, 2])
    tilted, to_viewer = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (tilted, to_viewer))
    found = bent(tilted, np.tile(UP, (2000, 1)), to_viewer)

    def mirrored(normal: ndarray) -> ndarray:
        return np.asarray((2.0 * (normal * to_viewer).sum(axis=1, keepdims=True) * normal - to_viewer)[:, 2])

    below = mirrored(tilted) < 0.0
    assert 100 < below.sum() < 1900
    assert (found[~below] == tilted[~below]).all()
    assert mirrored(found)[below] == pytest.approx(0.0, abs=1e-9)
    assert np.linalg.norm(found, axis=1) == pytest.approx(1.0)
    planes = np.linalg.det(np.stack([found, tilted, to_viewer], axis=1))
    assert planes == pytest.approx(0.0, abs=1e-9)
    assert ((found - tilted) * to_viewer).sum(axis=1).min() >= 0.0


def test_no_light_comes_from_behind() -> None:
    """Neither from below the tilted normal's horizon nor from below the surface's."""
    viewer, shades = _unit(0.0, -0.3, 1.0), _shades(0.5, 0.5, (0.0, 0.8, 0.6))
    directions = np.stack([_unit(0.0, 1.0, -0.1), _unit(0.0, -1.0, 0.5), _unit(0.0, 1.0, 0.1)])
    by_color, alone = reflected(_point(viewer), shades, directions)
    assert ((by_color + alone)[0] > 0.0).tolist() == [False, False, True]


def test_gradients_of_normals_and_metallic_are_those_of_the_image() -> None:
    """By differences of whole pictures, texel by texel, on a surface of which a part is bent."""
    case, step = cases.whole(("roughness", "metallic", "normal")), 5e-3
    grads = (case.smooth(), case.random())
    for name in ("metallic", "normal"):
        found = Quadrature(case.surface, case.materials, case.view, 2, 4).map_gradients(name, grads, 0)
        value = case.materials[0].maps[name]
        assert found.shape == (2, *value.shape)
        for texel in range(value.numel()):
            moved = (torch.eye(value.numel())[texel] * step).reshape(value.shape)
            more, less = (case.with_map(0, name, value.double() + sign * moved) for sign in (1.0, -1.0))
            images = [Quadrature(each.surface, each.materials, each.view, 2, 4).image() for each in (more, less)]
            slope = [((images[0] - images[1]) * grad).sum() / (2.0 * step) for grad in grads]
            assert found.reshape(2, -1)[:, texel] == pytest.approx(slope, rel=1e-2, abs=1e-2 * abs(found).max())


def test_a_clear_part_shows_what_is_behind() -> None:
    """Of an alpha of 0.3 over one of 0.5, over nothing: 0.3 of the first, 0.35 of the second, 0.65 is covered."""
    planes = scenes.joined(scenes.plane(2.0), scenes.quad((-2.0, -2.0, -1.0), (4.0, 0.0, 0.0), (0.0, 4.0, 0.0)))
    view, colors = _sheet(scenes.sun(32, 127)), scenes.lambertian((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    quadrature = Quadrature(with_alpha(planes, 0.3, 0.5), colors, view, 2, 4)
    sun = scenes.sun_direction(32, 127)[2]
    assert quadrature.coverage() == pytest.approx(0.65)
    assert quadrature.image() == pytest.approx(np.broadcast_to([0.3 * sun, 0.35 * 0.7 * sun, 0.0], (2, 2, 3)), rel=5e-3)
    assert seen(with_alpha(planes, 1.0, 0.5), view, 2).weight == pytest.approx(1.0)


def test_alpha_is_a_texture_over_uv() -> None:
    """Row 0 lies at v = 0; lookups are bilinear."""
    surface = with_alpha(scenes.plane(2.0), np.array([[0.0, 0.2], [0.4, 0.8]]))
    view = scenes.front_view(scenes.constant_light(), 2.0, width=8, height=8, vertical_fov=2.0 * math.atan(0.5))
    coverage = Quadrature(surface, scenes.lambertian((1.0, 1.0, 1.0)), view, 2, 2).coverage()
    assert coverage[[0, 0, 7, 7], [0, 7, 0, 7]] == pytest.approx([0.4, 0.8, 0.0, 0.2])
    assert coverage.mean() == pytest.approx(0.35)


def test_a_clear_lid_casts_a_part_of_a_shadow() -> None:
    """What it lets pass, and nothing of its colour."""
    surface, sun = (
        scenes.joined(scenes.floor(2.0), scenes.quad((-0.5, 0.5, 0.5), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0))),
        scenes.row_lights(0),
    )
    view = View(Camera((0.0, 0.2, 0.0), up=(0.0, 0.0, -1.0), vertical_fov=0.1), sun, 2, 2)
    colors = scenes.lambertian((0.5, 0.5, 0.5), (1.0, 0.0, 0.0))
    whole, none = (Quadrature(with_alpha(surface, 1.0, alpha), colors, view, 2, 4).image() for alpha in (0.0, 1.0))
    assert none == pytest.approx(0.0)
    assert Quadrature(with_alpha(surface, 1.0, 0.3), colors, view, 2, 4).image() == pytest.approx(0.7 * whole)
