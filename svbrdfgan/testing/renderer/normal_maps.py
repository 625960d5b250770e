"""Tilted normals where `normal` is declared: `docs/conventions.md`, against quadrature."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from svbrdfgan.testing import scenes
from svbrdfgan.testing.kit import declared
from svbrdfgan.testing.renderer.brightness import Inputs, MeasuredKit, check_zero, expected
from svbrdfgan.types import Material, Materials, Surface, View

FRONT = (0.0, 0.0, 1.0)
BACK = (0.0, 0.0, -1.0)
ORIGIN = (0.0, 0.0, 0.0)
TILTS = ((0.5, 0.0, 0.8), (-0.5, 0.0, 0.8), (0.0, 0.5, 0.8), (0.0, -0.5, 0.8), (0.0, 0.0, 1.0))
_NAMES = "Tilted towards +u, -u, +v, -v, and not"
_BESIDE = (10, 55, 32, 64)
"""A pixel of an environment of 32 x 64, that lights the plane from above and, more, from the right."""

Constants = dict[str, float | Sequence[float] | Tensor]


class NormalMapTests(MeasuredKit):
    """The tangent frame, the lookup, both horizons, and no black rims. Lambertian, unless gloss must be there."""

    def test_normals_tilt_towards_u_and_v(self) -> None:
        """A normal map's +x leans to growing u and its +y to growing v."""
        self._require_tilts(scenes.plane(), FRONT, "is green flipped, or are the channels exchanged?")

    def test_normals_tilt_with_turned_uvs(self) -> None:
        """Where UVs are turned by a quarter, so are the tilts."""
        plane = scenes.plane()
        turned = dataclasses.replace(plane, uv=np.stack([plane.uv[:, 1], 1.0 - plane.uv[:, 0]], axis=-1))
        self._require_tilts(turned, FRONT, "UVs turned by a quarter; does the tangent follow growing u?")

    def test_normals_tilt_with_mirrored_uvs(self) -> None:
        """Where UVs are mirrored, +x still leans to growing u and +y to growing v."""
        plane = scenes.plane()
        for axis, sign in (("u", [-1.0, 1.0]), ("v", [1.0, -1.0])):
            mirrored = dataclasses.replace(plane, uv=0.5 + (plane.uv - 0.5) * sign)
            self._require_tilts(mirrored, FRONT, f"{axis} mirrored; is the handedness right?")

    def test_relief_pushes_through(self) -> None:
        """From behind, relief is that of the front, pushed through the sheet."""
        self._require_tilts(scenes.plane(), BACK, "seen from behind; is the whole normal turned over?", back=True)

    def test_normals_tilt_from_the_shading_normal(self) -> None:
        """Tangents are perpendicular to the interpolated shading normal."""
        plane = scenes.plane()
        lean = np.where(plane.positions[:, :1] > 0.0, 1.0, -1.0) * np.array([0.6, 0.0, 0.0])
        round_plane = dataclasses.replace(plane, normals=lean + np.array([0.0, 0.0, 0.8]))
        self._require_tilts(round_plane, FRONT, "a plane with round shading normals", at=(0.3, 0.1, 0.0))

    def test_a_neutral_normal_changes_nothing(self) -> None:
        """(0, 0, 1) and (0, 0, 0.3) look as no normal map does, from the front and aslant."""
        _declares(self)
        plain: Constants = {"base_color": (0.5, 0.5, 0.5), **self._gloss}
        flat = [torch.tensor(normal) for normal in ((0.0, 0.0, 1.0), (0.0, 0.0, 0.3))]
        maps: list[Constants] = [plain, *({**plain, "normal": normal} for normal in (*flat, flat[1].expand(2, 3, 3)))]
        for towards in (FRONT, (0.9, 0.1, 0.3)):
            view = scenes.spot_view(ORIGIN, towards, scenes.random_light())
            runs = self.brightnesses(*((scenes.plane(), Materials((scenes.material(**m),)), view) for m in maps))
            self.check_ratios(runs, np.ones(4), f"No normal map, (0, 0, 1), (0, 0, 0.3), texels of it, from {towards}.")

    def test_normals_are_looked_up_and_then_scaled(self) -> None:
        """Between texels of other lengths lies the direction of their mean; the length does not matter."""
        _declares(self)
        texels = torch.tensor([[[0.3, 0.0, 0.1], [0.0, 0.0, 0.9]]])
        normals = (texels, torch.tensor([0.15, 0.0, 0.5]), torch.tensor([0.3, 0.0, 1.0]), torch.tensor(FRONT))
        view = scenes.spot_view(ORIGIN, FRONT, scenes.sun(*_BESIDE), extent=0.001)
        runs = self.brightnesses(*(_tilted(normal, view) for normal in normals))
        truth = expected(*(_tilted(normal, view) for normal in normals), split=4).mean(axis=-1)
        self.check_ratios(runs, truth, "Between (0.3, 0, 0.1) and (0, 0, 0.9), their mean, twice that, and (0, 0, 1).")

    def test_normal_maps_lie_as_textures(self) -> None:
        """Texels of a normal map lie where those of a base colour would."""
        _declares(self)
        texels = torch.tensor(TILTS[:4]).reshape(2, 2, 3)
        light = scenes.sun(*_BESIDE)
        spots = [scenes.spot_view((x, y, 0.0), FRONT, light) for y in (-0.25, 0.25) for x in (-0.25, 0.25)]
        cases = [_tilted(texels, view) for view in spots]
        truth = expected(*cases, split=4).mean(axis=-1)
        self.check_ratios(self.brightnesses(*cases), truth, "Texels (0, 0), (0, 1), (1, 0), (1, 1) of other tilts.")

    def test_a_part_without_normals_stays_flat(self) -> None:
        """Beside a part with a normal map, one without is flat."""
        _declares(self)
        tilted, plain = scenes.material(base_color=(0.5, 0.5, 0.5), normal=TILTS[0]), _grey()
        view = scenes.spot_view((0.5, 0.0, 0.0), FRONT, scenes.sun(*_BESIDE))
        mixed, alone = Materials((tilted, plain)), Materials((plain, plain))
        runs = self.brightnesses(*((scenes.two_parts(), materials, view) for materials in (mixed, alone)))
        self.check_ratios(runs, [1.0, 1.0], "A flat part beside a tilted one, and beside a flat one.")

    def test_no_light_comes_from_behind(self) -> None:
        """Light from below the surface is none, even if the normal leans to it; nor is light from below its own."""
        _declares(self)
        below, low = scenes.sun(32, 36), scenes.sun(32, 100)  # at -X and a little -Z, at +X and a little +Z
        for what, normal, light in (
            ("a sun behind the surface that the normal leans to", (-0.9, 0.0, 0.3), below),
            ("a sun before the surface and behind the normal", (-0.9, 0.0, 0.3), low),
        ):
            material = scenes.material(base_color=(0.8, 0.8, 0.8), normal=normal, **self._gloss)
            view = scenes.spot_view(ORIGIN, (-0.1, 0.0, 1.0), light)
            image = self.render(scenes.plane(), Materials((material,)), view, spp=64).image
            check_zero(image.cpu().numpy(), f"In {what} a tilted plane should be black.")

    def test_rims_are_not_black(self) -> None:
        """Normals that turn away from the viewer are bent to it, as by quadrature."""
        _declares(self)
        maps: list[Constants] = [
            {"normal": normal} for normal in ((-0.6, 0.0, 0.8), (-0.95, 0.0, 0.3), (0.3, 0.5, 0.7))
        ]
        if "metallic" in self.capabilities.maps:
            maps += [{**each, "roughness": 0.5, "metallic": 1.0} for each in maps]
        materials = [Materials((scenes.material(base_color=(0.9, 0.9, 0.9), **each),)) for each in (*maps, {})]
        for towards, light in (
            ((0.9, 0.0, 0.3), scenes.constant_light(1.0, 16, 32)),
            ((0.6, 0.0, 0.5), scenes.sun(*_BESIDE)),
        ):
            view = scenes.spot_view(ORIGIN, towards, light)
            cases: list[Inputs] = [(scenes.plane(), each, view) for each in materials]
            truth = expected(*cases, split=4).mean(axis=-1)
            message = f"From {towards}: normals turned away, far away, and to a side; then of metal; then flat."
            self.check_ratios(self.brightnesses(*cases, spp=64), truth, message)

    @property
    def _gloss(self) -> Constants:
        return {"roughness": 0.5} if "roughness" in self.capabilities.maps else {}

    def _require_tilts(
        self,
        surface: Surface,
        towards: tuple[float, float, float],
        what: str,
        *,
        back: bool = False,
        at: Sequence[float] = ORIGIN,
    ) -> None:
        """Fails unless tilts brighten and darken the surface, in a sun beside the viewer, as quadrature says."""
        _declares(self)
        row, col, *size = _BESIDE
        view = scenes.spot_view(at, towards, scenes.sun(row, size[1] // 2 - (size[1] - col) if back else col, *size))
        cases: list[Inputs] = [(surface, Materials((_grey(normal),)), view) for normal in TILTS]
        truth = expected(*cases, split=4).mean(axis=-1)
        self.check_ratios(self.brightnesses(*cases), truth, f"{_NAMES}: {what}")


def _declares(kit: MeasuredKit) -> None:
    declared("normal" in kit.capabilities.maps, "normal")


def _grey(normal: tuple[float, float, float] | Tensor | None = None) -> Material:
    tilt: Constants = {} if normal is None else {"normal": normal}
    return scenes.material(base_color=(0.5, 0.5, 0.5), **tilt)


def _tilted(normal: Tensor, view: View) -> Inputs:
    return scenes.plane(), Materials((_grey(normal),)), view
