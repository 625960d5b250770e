"""Pictures for people: exposure, the floor without a horizon, its shadow, the tone curve, framing."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
import torch

from svbrdfgan.errors import AssetError
from svbrdfgan.geometry.camera_hits import camera_hits
from svbrdfgan.geometry.split import surface_over
from svbrdfgan.inference import studio as studio_module
from svbrdfgan.inference.ground import Cove, on_floor
from svbrdfgan.inference.studio import BOUNCES, Studio
from svbrdfgan.inference.tone_mapping import neutral_tone
from svbrdfgan.plugins.registry import load_bouncing
from svbrdfgan.procedural.sky import build_sky, sample_sky
from svbrdfgan.procedural.softboxes import build_studio
from svbrdfgan.rendering.checked_renderer import CheckedRenderer
from svbrdfgan.types import Material, Materials, Mesh, Part, Surface

SIZE = (64, 36)
GREY = Materials((Material.lambertian((0.5, 0.5, 0.5)),))


@pytest.fixture(scope="module")
def box() -> Surface:
    corners = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (0.4, 1.6) for z in (-2.0, 2.0)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([triangle for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))])
    mesh = Mesh(corners, faces, np.zeros(len(faces), dtype=np.int64), (Part("floor"),))
    return surface_over(mesh, np.zeros((len(faces), 3, 2)))


@pytest.fixture(scope="module")
def renderer(quick_glossy_renderer: str) -> CheckedRenderer:
    return load_bouncing(quick_glossy_renderer, {}, BOUNCES)


@pytest.fixture(autouse=True)
def without_denoiser(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(studio_module, "can_denoise", lambda: False)


def test_a_base_colour_in_even_white_light_keeps_its_value() -> None:
    color = torch.rand(8, 8, 3, generator=torch.Generator().manual_seed(0)) * 0.65 + 0.05
    torch.testing.assert_close(neutral_tone(color + 0.04), color)


def test_the_tone_curve_is_monotonous_and_ends_at_white() -> None:
    grey = torch.logspace(-5, 5, 1000)[None, :, None].expand(1, 1000, 3)
    mapped = neutral_tone(grey)
    assert (mapped.diff(dim=1) >= 0).all()
    assert mapped.min() >= 0
    assert 0.999 < mapped.max() <= 1
    assert (neutral_tone(torch.tensor([[[100.0, 10.0, 1.0]]])) > 0.85).all()


@pytest.mark.parametrize("light", [build_studio(), build_sky(sample_sky(3)), 1000 * build_studio()])
def test_a_picture_has_no_horizon(light: torch.Tensor, box: Surface, renderer: CheckedRenderer) -> None:
    shown = Studio(renderer, light).stand(box).show(GREY, size=SIZE, spp=64)
    background = neutral_tone(Cove.of(light, toward()).floor[None, None])[0, 0]
    for border in (shown[0], shown[:12, 0], shown[:12, -1]):
        torch.testing.assert_close(border.mean(dim=0), background, atol=0.04, rtol=0.0)


def test_the_floor_is_dark_beneath_the_object_alone(box: Surface, renderer: CheckedRenderer) -> None:
    stand = Studio(renderer, torch.ones(8, 16, 3)).stand(box)
    grey = stand.show(GREY, size=SIZE, spp=64).mean(dim=-1)
    below = grey[grey.shape[0] // 2 :, SIZE[0] // 2 - 4 : SIZE[0] // 2 + 4]
    assert below.min() < 0.7 * grey[0].mean()
    assert grey.min() > 0


def test_direct_light_alone_shows_nearly_the_same(
    box: Surface, renderer: CheckedRenderer, quick_glossy_renderer: str
) -> None:
    direct = load_bouncing(quick_glossy_renderer, {}, 1)
    pictures = [Studio(each, build_studio()).stand(box).show(GREY, size=SIZE, spp=64) for each in (renderer, direct)]
    assert abs(pictures[0] - pictures[1]).mean() < 0.03


def test_surfaces_of_one_shape_share_their_shadow(box: Surface, quick_glossy_renderer: str) -> None:
    direct = Studio(load_bouncing(quick_glossy_renderer, {}, 1), build_studio())
    other = replace(box, uv=box.uv + 0.5)
    shared = direct.stand(box)
    shared.show(GREY, size=SIZE, spp=16)
    pictures = [stand.show(GREY, size=SIZE, spp=16) for stand in (shared.sharing_shadow(other), direct.stand(other))]
    torch.testing.assert_close(*pictures)


def test_white_is_not_burnt_and_black_is_no_hole(box: Surface, renderer: CheckedRenderer) -> None:
    def shown(color: float) -> torch.Tensor:
        gloss = {"base_color": torch.full((3,), color), "roughness": torch.tensor([0.3])}
        return Studio(renderer, build_studio()).stand(box).show(Materials((Material(gloss),)), size=SIZE, spp=64)

    white, black = shown(0.85), shown(0.02)
    paint = abs(white - black).mean(dim=-1) > 0.2
    assert 0.1 < paint.float().mean() < 0.9
    assert (white[paint].amax(dim=-1) < 0.99).float().mean() > 0.95
    assert black[paint].mean() > 0.002


def test_the_object_fills_the_picture_and_touches_no_border(box: Surface) -> None:
    for stretched in (box.positions, box.positions * [1.0, 6.0, 1.0], box.positions * 1000.0):
        surface = replace(box, positions=stretched)
        hit = camera_hits(surface, studio_module._camera(surface, (160, 90)), 160, 90).hit
        rows, cols = hit.any(axis=1), hit.any(axis=0)
        assert not rows[[0, -1]].any()
        assert not cols[[0, -1]].any()
        assert max(rows.mean(), cols.mean()) > 0.75


def test_the_floor_lies_beneath_the_object_under_a_name_of_its_own(box: Surface) -> None:
    standing = on_floor(box)
    assert standing.positions[-4:, 1].max() < box.positions[:, 1].min()
    assert standing.positions[-4:, 1].max() > box.positions[:, 1].min() - 0.01
    assert [part.name for part in standing.parts] == ["floor", "floor_"]


def test_the_floor_ends_beyond_the_picture(box: Surface) -> None:
    for stretched in (box.positions, box.positions * [1.0, 6.0, 1.0], box.positions * [6.0, 1.0, 1.0]):
        surface = replace(box, positions=stretched)
        camera = studio_module._camera(surface, (160, 90))
        assert camera_hits(on_floor(surface), camera, 160, 90).hit.all()  # else its end is a line in the guides


def test_the_denoiser_gets_the_picture_and_its_guides(
    box: Surface, renderer: CheckedRenderer, monkeypatch: pytest.MonkeyPatch
) -> None:
    fake = _Denoiser({})
    monkeypatch.setattr(studio_module, "can_denoise", lambda: True)
    monkeypatch.setitem(sys.modules, "pyoidn", fake)
    shown = Studio(renderer, build_studio()).stand(box).show(GREY, size=SIZE, spp=1)
    torch.testing.assert_close(shown, neutral_tone(torch.full((36, 64, 3), 0.25)))
    assert fake.given["hdr"] is True
    albedo, normal = fake.given["albedo"], fake.given["normal"]
    assert albedo.shape == normal.shape == (36, 64, 3)
    assert (abs(albedo[..., None] - [0.5, 0.6]) < 1e-5).any(axis=-1).mean() > 0.9  # box and floor; edges are between
    assert (abs(np.linalg.norm(normal, axis=-1) - 1.0) < 1e-5).mean() > 0.8


def test_a_denoiser_that_fails_leaves_the_noise(
    box: Surface, renderer: CheckedRenderer, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    noisy = Studio(renderer, build_studio()).stand(box).show(GREY, size=SIZE, spp=1)
    monkeypatch.setattr(studio_module, "can_denoise", lambda: True)
    monkeypatch.setitem(sys.modules, "pyoidn", None)
    torch.testing.assert_close(Studio(renderer, build_studio()).stand(box).show(GREY, size=SIZE, spp=1), noisy)
    assert "keeps its noise, since Open Image Denoise does not work here" in caplog.text


def test_a_light_from_below_alone_is_refused(renderer: CheckedRenderer) -> None:
    light = torch.zeros(8, 16, 3)
    light[4:] = 1.0
    with pytest.raises(AssetError, match="black above the horizon"):
        Studio(renderer, light)


@dataclass
class _Denoiser:
    given: dict[str, Any]

    def denoise(self, color: np.ndarray, **given: Any) -> np.ndarray:
        self.given.update(given)
        return np.full_like(color, 0.25)


def toward() -> tuple[float, float, float]:
    azimuth, elevation = math.radians(studio_module._AZIMUTH), math.radians(studio_module._ELEVATION)
    return math.sin(azimuth) * math.cos(elevation), math.sin(elevation), math.cos(azimuth) * math.cos(elevation)
