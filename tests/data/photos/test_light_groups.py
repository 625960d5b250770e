"""Pictures in one light: the light is estimated from all of them, and turns with the camera of a turntable."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch
from stand_ins import SMALL, Photographer, StandIn, make_stand_ins

from svbrdfgan.config.yaml_files import load_yaml
from svbrdfgan.data.exemplars import load_exemplars
from svbrdfgan.data.index import Dataset
from svbrdfgan.data.photos.build import import_pictures
from svbrdfgan.data.photos.calibrated_camera import CalibratedCamera
from svbrdfgan.data.photos.light import Evidence, estimate_light, white
from svbrdfgan.data.photos.manifest import PictureEntry, read_manifest
from svbrdfgan.plugins.registry import load_renderer
from svbrdfgan.scene.description import OrbitCamera
from svbrdfgan.types import Environment, View

GREY = (0.18, 0.18, 0.18)
CPU = {"device": "cpu"}


@pytest.mark.parametrize("azimuth", [-120.0, 0.0, 90.0])
@pytest.mark.parametrize("elevation", [0.0, 40.0, 89.9, -89.9])
def test_the_heading_is_the_azimuth_however_steep_the_camera_is(azimuth: float, elevation: float) -> None:
    orbit = OrbitCamera(azimuth_degrees=azimuth, elevation_degrees=elevation, distance=2.0)
    calibrated = CalibratedCamera.of(orbit.camera(), (60, 40))
    for camera in (orbit, calibrated):
        found = PictureEntry(file="a.jpg", mesh="a.glb", camera=camera).heading
        assert math.degrees(found) == pytest.approx(azimuth, abs=1e-6)


def evidence(rng: np.random.Generator, lit: np.ndarray, sees: slice, gain: float) -> Evidence:
    """A picture of matt surfaces that are lit by these lobes above all, with a little noise."""
    strength = np.full(len(lit), 0.05)
    strength[sees] = 1.0
    shown = rng.uniform(0.1, 1, size=(300, 1, len(lit))) * strength / len(lit) * np.ones((3, 1))
    base = rng.uniform(0.2, 0.6, size=(300, 1)) * np.ones(3)
    radiance = np.einsum("pcl,l->pc", shown, lit) * (base + 0.02) * rng.normal(1, 0.02, size=(300, 1))
    return Evidence(radiance / gain, base, shown, np.ones((1, len(base)), bool), np.empty((0, *base.shape)))


def test_pictures_determine_together_what_each_leaves_open() -> None:
    """Each of three pictures sees mainly two thirds of the lobes, with another exposure."""
    rng = np.random.default_rng(3)
    lit = rng.uniform(0.3, 3, size=24)
    sees, true = (slice(0, 16), slice(8, 24), slice(4, 20)), (0.7, 1.0, 1 / 0.7)
    pictures = [evidence(rng, lit, part, gain) for part, gain in zip(sees, true, strict=True)]
    found = estimate_light(pictures, GREY)
    assert found.gains == pytest.approx(true, rel=0.15)
    alone = [estimate_light([one], GREY) for one in pictures]
    assert [one.gains.tolist() for one in alone] == [[1.0]] * 3

    def error(weights: np.ndarray) -> float:
        return float(np.abs(weights.mean(axis=0) / weights.mean() - lit / lit.mean()).mean())

    assert error(found.weights) < 0.9 * min(error(one.weights) for one in alone)


def room(column: int, window: float) -> torch.Tensor:
    """Light of a room with a window."""
    found = torch.full((16, 32, 3), 0.3) * torch.tensor([1.0, 0.9, 0.8])
    found[4:9, column - 3 : column + 3] = window
    return found


@pytest.mark.full
def test_a_turntable_s_light_is_known_better_from_all_its_pictures(tmp_path: Path) -> None:
    """`python -m pytest -m full -s` prints the errors for docs/lab/own-pictures.md."""
    skies = (room(8, 30.0), room(24, 12.0))
    photographer = Photographer(
        load_renderer("mitsuba", CPU | {"max_bounces": 3}), skies, (240, 160), 32, turntable=True
    )
    taken = make_stand_ins(tmp_path, photographer, vehicles=2, views=8)
    given = load_yaml(tmp_path / "manifest.yaml")
    apart = given | {
        "pictures": [
            {k: v for k, v in one.items() if k not in ("light_group", "turntable")} for one in given["pictures"]
        ]
    }
    errors, pool = {}, {"environments": {"procedural": {"count": 12, "seed": 1}}}
    for name, data in (("alone", apart), ("together", given)):
        records = import_pictures(read_manifest(data | SMALL | pool, name), tmp_path / name, base=tmp_path)
        errors[name] = light_errors(tmp_path / name, taken, skies)
        print(name, {key: round(value, 3) for key, value in errors[name].items()})
        exposures = np.array([one.exposure for one in records]) * [one.gain for one in taken]
        spread = float(np.exp(np.std(np.log(exposures / np.repeat(exposures.reshape(2, 8).mean(axis=1), 8)))))
        print(f"exposure: spread x {spread:.3f}")
    assert errors["together"]["shape"] < 0.75 * errors["alone"]["shape"]


def light_errors(folder: Path, taken: list[StandIn], skies: tuple[torch.Tensor, ...]) -> dict[str, float]:
    """The error of the light that a white object reflects to the camera, and without one factor for each channel."""
    found, renderer = load_exemplars(Dataset.open(folder), "train"), load_renderer("mitsuba", CPU)
    whole, shape = [], []
    for index, one in enumerate(taken):
        subject, view = found.subject(index), found.loader.view(found.scenes[index])
        prepared, materials = renderer.prepare(subject.surface), white(subject.learnable, len(subject.surface.parts))
        true = View(view.camera, Environment(skies[one.sky] / skies[one.sky].mean(), one.turn), 48, 48)
        made, wanted = (renderer.render(prepared, materials, at, spp=256, seed=1) for at in (view, true))
        full = made.coverage > 0.99
        ratio = made.image[full] / wanted.image[full].clamp(min=1e-3)
        ratio = ratio / ratio.median()  # exposure is apart
        whole.append(float((ratio - 1).abs().median()))
        shape.append(float((ratio / ratio.median(dim=0).values - 1).abs().median()))
    return {"light": float(np.mean(whole)), "shape": float(np.mean(shape))}
