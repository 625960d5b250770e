"""Blender's Cycles sees the scenes that our renderers see: mesh, camera, light and textures lie where they should."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from svbrdfgan.config.choices import PartSelection
from svbrdfgan.data.photos.pairs import FlashShading
from svbrdfgan.data.staged_photos.cycles import Second, Shot, find_blender, take
from svbrdfgan.geometry.camera_hits import camera_hits
from svbrdfgan.io.environment import load_environment, save_environment
from svbrdfgan.io.exr import load_exr
from svbrdfgan.io.image import load_image
from svbrdfgan.plugins.registry import load_embedding
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.sky import build_sky, sample_sky
from svbrdfgan.procedural.vehicle import build_vehicle
from svbrdfgan.rendering.checked_renderer import CheckedRenderer
from svbrdfgan.scene.embedded_files import save_materials
from svbrdfgan.scene.subject import Subject, make_subject
from svbrdfgan.types import Camera, Environment, Layer, View

pytestmark = pytest.mark.full
SIZE = (160, 120)
TURN = math.radians(70)


@pytest.fixture(scope="module")
def subject() -> Subject:
    mesh = build_vehicle(sample_vehicle("sedan", 5))
    return make_subject(mesh, load_embedding("hemispherical", {}), 64, PartSelection(include=("*",), exclude=()))


@pytest.fixture(scope="module")
def shot(subject: Subject, tmp_path_factory: pytest.TempPathFactory) -> Shot:
    """Of a vehicle whose left half is red, in a sky with a sun, without a camera's effects."""
    folder = tmp_path_factory.mktemp("cycles")
    save_environment(folder / "sky.exr", build_sky(sample_sky(3), 64))
    save_materials(folder / "sedan.glb", subject, subject.materials(halves(subject)))
    lower, upper = subject.surface.positions.min(axis=0), subject.surface.positions.max(axis=0)
    middle, size = (lower + upper) / 2, float(np.linalg.norm(upper - lower))
    camera = Camera.orbit(0.7, 0.35, 1.6 * size, tuple(middle.tolist()), math.radians(35))
    return Shot(
        photo=str(folder / "linear.exr"),
        mesh=str(folder / "sedan.glb"),
        environment=str(folder / "sky.exr"),
        rotation=TURN,
        scale=1.5,
        origin=camera.origin,
        target=camera.target,
        vertical_fov=camera.vertical_fov,
        width=SIZE[0],
        height=SIZE[1],
        samples=64,
        bounces=0,
        seed=1,
    )


def halves(subject: Subject) -> Layer:
    """Opaque red where x is above 0, and grey elsewhere."""
    red = subject.buffer.position[..., :1] > 0
    color = torch.where(red, torch.tensor([0.6, 0.05, 0.05]), torch.tensor([0.3, 0.3, 0.3]))
    return Layer(torch.cat([color, torch.ones_like(color[..., :1])], dim=-1))


@pytest.fixture
def blender(blender_python: Path) -> list[str]:
    return find_blender(str(blender_python))


def test_cycles_and_our_renderer_see_the_same(
    shot: Shot, subject: Subject, blender: list[str], cpu_renderer: Any, quick_renderer: str
) -> None:
    assert list(take([shot], blender)) == [0]
    channels = load_exr(Path(shot.photo))
    theirs = torch.stack([channels[name] for name in "RGB"], dim=-1)
    renderer = CheckedRenderer(cpu_renderer, quick_renderer)
    camera = Camera(shot.origin, shot.target, vertical_fov=shot.vertical_fov)
    light = Environment(load_environment(shot.environment) * shot.scale, shot.rotation)
    surface, materials = renderer.prepare(subject.surface), subject.materials(halves(subject))
    ours = renderer.render(surface, materials, View(camera, light, *SIZE), spp=64, seed=0)
    inside = ours.coverage > 0.99
    assert inside.float().mean() > 0.05
    own, other = ours.image[inside], theirs[inside]
    assert np.corrcoef(own.flatten().numpy(), other.flatten().numpy())[0, 1] > 0.95
    assert 0.9 < float(other.mean() / own.mean()) < 1.25, "Blender's material reflects some light off its surface"
    apart = (theirs.sum(dim=-1) > 1e-4) != (ours.coverage > 0.5)
    assert apart.float().mean() < 0.02, "the silhouettes agree"


def test_a_flash_lights_as_an_import_believes(shot: Shot, subject: Subject, blender: list[str], tmp_path: Path) -> None:
    """Brightness, cosine and distance; of the red half, where gloss hardly matters."""
    flash = replace(shot, photo=str(tmp_path / "a.exr"), second=Second(str(tmp_path / "b.exr"), flash=0.8))
    assert list(take([flash], blender)) == [0]
    without, lit = (load_image(tmp_path / name)[..., 0] for name in ("a.exr", "b.exr"))
    camera = Camera(shot.origin, shot.target, vertical_fov=shot.vertical_fov)
    hits = camera_hits(subject.surface, camera, *SIZE, per_pixel=3)
    distance = float(np.linalg.norm(np.subtract(shot.origin, shot.target)))
    shading = FlashShading.of(hits.centres(3))
    red = (hits.hit & (hits.interpolate(subject.surface.positions)[..., 0] > 0.01)).reshape(SIZE[1], 3, SIZE[0], 3)
    whole = torch.from_numpy(red.all(axis=(1, 3))) & shading.clear
    found = (lit - without)[whole] / (0.8 * distance**2 * shading.values[whole])
    assert whole.sum() > 500
    assert float(found.median()) == pytest.approx(0.6, rel=0.04)
    assert float((found - found.median()).abs().median()) < 0.03


def test_a_second_picture_has_the_first_one_s_exposure(shot: Shot, blender: list[str], tmp_path: Path) -> None:
    dark = replace(
        shot, photo=str(tmp_path / "a.exr"), exposure_stops=-3.0, second=Second(str(tmp_path / "b.exr"), shot.mesh)
    )
    assert list(take([dark], blender)) == [0]
    first, second = (load_image(tmp_path / name) for name in ("a.exr", "b.exr"))
    torch.testing.assert_close(first, second, rtol=2e-3, atol=2e-3)
    assert float(first[..., :3].mean()) < 0.05


def test_a_photograph_is_metered_developed_and_compressed(shot: Shot, blender: list[str], tmp_path: Path) -> None:
    common = {"bounces": 4, "background": True, "ground": (0.2, 0.2, 0.2), "f_number": 4.0, "noise": 0.01}
    plain = replace(shot, photo=str(tmp_path / "0.jpg"), exposure_stops=0.0, view="AgX", samples=16, **common)
    dark = replace(plain, photo=str(tmp_path / "1.jpg"), exposure_stops=-2.0)
    brighter = replace(plain, photo=str(tmp_path / "2.jpg"), scale=15.0)
    assert list(take([plain, dark, brighter], blender)) == [0, 1, 2]
    pictures = [np.asarray(Image.open(each.photo), dtype=float) for each in (plain, dark, brighter)]
    assert pictures[0].shape == (SIZE[1], SIZE[0], 3)
    assert 60 < pictures[0].mean() < 190
    assert pictures[1].mean() < 0.75 * pictures[0].mean()
    assert abs(pictures[2] - pictures[0]).mean() < 6, "the meter takes out how bright the light is"
