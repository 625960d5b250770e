"""The scenes that fakes are rendered in."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from svbrdfgan.config.models import validate
from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.data.index import DatasetIndex
from svbrdfgan.errors import ConfigError
from svbrdfgan.plugins.registry import load_renderer
from svbrdfgan.rendering.checked_renderer import CheckedRenderer
from svbrdfgan.scene.description import Scene
from svbrdfgan.scene.subject import Subject
from svbrdfgan.training.cached_rendering import CachedRendering
from svbrdfgan.training.config import ScenesConfig
from svbrdfgan.training.perturb import Perturbation


def perturbation(folder: Path, **declared: Any) -> Perturbation:
    return Perturbation(validate(ScenesConfig, declared, "here"), DatasetIndex.load(folder).sampler("train"))


def drawn(folder: Path, exemplar: Scene, count: int = 300, **declared: Any) -> list[Scene]:
    rng = np.random.default_rng(0)
    return [perturbation(folder, **declared).scene(exemplar, 0, rng) for _ in range(count)]


def test_matched_keeps_the_scene_but_for_its_samples(tiny_dataset: Path, tiny_exemplars: Exemplars) -> None:
    exemplar = tiny_exemplars.scenes[0]
    scenes = drawn(tiny_dataset, exemplar, 20)
    assert {scene.model_copy(update={"seed": 0}).model_dump_json() for scene in scenes} == {
        exemplar.model_copy(update={"seed": 0}).model_dump_json()
    }
    assert len({scene.seed for scene in scenes} | {exemplar.seed}) == 21


def test_camera_noise_is_uniform_in_its_range(tiny_dataset: Path, tiny_exemplars: Exemplars) -> None:
    exemplar = tiny_exemplars.scenes[0]
    scenes = drawn(tiny_dataset, exemplar, camera_noise_degrees=4.0)
    azimuth = np.array([(s.camera.azimuth_degrees - exemplar.camera.azimuth_degrees + 180) % 360 - 180 for s in scenes])
    elevation = np.array([s.camera.elevation_degrees - exemplar.camera.elevation_degrees for s in scenes])
    for noise in (azimuth, elevation):
        assert np.abs(noise).max() <= 4.0 + 1e-9
        assert noise.min() < -3.8
        assert noise.max() > 3.8
        assert abs(noise.mean()) < 5 * 4 / np.sqrt(3 * len(noise))
    assert abs(np.corrcoef(azimuth, elevation)[0, 1]) < 0.3
    kept = {"distance", "target", "vertical_fov_degrees"}
    assert {str(s.camera.model_dump(include=kept)) for s in scenes} == {str(exemplar.camera.model_dump(include=kept))}
    assert {s.environment.model_dump_json() for s in scenes} == {exemplar.environment.model_dump_json()}


def test_noise_never_looks_from_beyond_the_pole(tiny_dataset: Path, tiny_exemplars: Exemplars) -> None:
    exemplar = tiny_exemplars.scenes[0]
    high = exemplar.model_copy(update={"camera": exemplar.camera.model_copy(update={"elevation_degrees": 88.0})})
    for scene in drawn(tiny_dataset, high, 100, camera_noise_degrees=30.0):
        assert scene.camera.elevation_degrees <= 89.0
        scene.camera.camera()


def test_redrawn_environments_come_from_the_splits_own(tiny_dataset: Path, tiny_exemplars: Exemplars) -> None:
    exemplar = tiny_exemplars.scenes[0]
    scenes = drawn(tiny_dataset, exemplar, 60, environment="redrawn")
    pool = {light.asset.path for light in DatasetIndex.load(tiny_dataset).environments["train"]}
    assert {scene.environment.asset.path for scene in scenes} == pool
    assert len({scene.environment.rotation_degrees for scene in scenes}) == 60
    assert {scene.camera.model_dump_json() for scene in scenes} == {exemplar.camera.model_dump_json()}


def test_another_pool_replaces_the_splits_own(tiny_dataset: Path, tiny_exemplars: Exemplars) -> None:
    told = perturbation(tiny_dataset, environment={"procedural": {"count": 1, "seed": 9}})
    asset = told.sampler.environments[0].asset.model_copy(update={"path": "elsewhere.exr"})
    other = told.sampler.environments[0].model_copy(update={"asset": asset})
    scene = replace(told, environments=(other,)).scene(tiny_exemplars.scenes[0], 0, np.random.default_rng(0))
    assert scene.environment.asset.path == "elsewhere.exr"


def test_cameras_are_drawn_anew(tiny_dataset: Path, tiny_exemplars: Exemplars) -> None:
    camera = {"azimuth_degrees": {"uniform": [10, 20]}, "elevation_degrees": 50.0, "distance": 2.0}
    scenes = drawn(tiny_dataset, tiny_exemplars.scenes[0], 50, camera=camera)
    assert all(10 <= scene.camera.azimuth_degrees <= 20 for scene in scenes)
    assert {scene.camera.elevation_degrees for scene in scenes} == {50.0}
    assert len({scene.camera.azimuth_degrees for scene in scenes}) == 50


def test_what_is_matched() -> None:
    assert ScenesConfig().matched
    assert ScenesConfig(pool=3).matched
    assert not ScenesConfig(camera_noise_degrees=1.0).matched
    assert not ScenesConfig(environment="redrawn").matched


def stages(exemplars: Exemplars, folder: Path, pool: int, **declared: Any) -> CachedRendering:
    return CachedRendering(
        exemplars, perturbation(folder, **declared), load_renderer("numpy"), 4, pool, torch.device("cpu"), seed=2
    )


@pytest.mark.parametrize("pool", [1, 3])
def test_a_pool_holds_so_many_scenes(pool: int, tiny_dataset: Path, tiny_exemplars: Exemplars) -> None:
    held = stages(tiny_exemplars, tiny_dataset, pool, camera_noise_degrees=5.0)
    held.build([0, 4])
    assert len(held._transports.held) == 2 * pool
    rng = np.random.default_rng(0)
    pictures = {held.scenes([0], rng).batch.coverage.numpy().tobytes() for _ in range(12)}
    assert len(pictures) == pool
    assert len(held._transports.held) == 2 * pool


def test_without_a_pool_every_visit_is_new(tiny_dataset: Path, tiny_exemplars: Exemplars) -> None:
    fresh, rng = stages(tiny_exemplars, tiny_dataset, 0, camera_noise_degrees=5.0), np.random.default_rng(0)
    fresh.build([0])
    pictures = {fresh.scenes([0], rng).batch.transports[0].weight.numpy().tobytes() for _ in range(4)}
    assert len(pictures) == 4
    assert fresh._transports.held == {}


def test_a_surface_is_prepared_once_whatever_is_visited(
    tiny_dataset: Path, tiny_exemplars: Exemplars, monkeypatch: pytest.MonkeyPatch
) -> None:
    fresh, made = stages(tiny_exemplars, tiny_dataset, 0, camera_noise_degrees=5.0), []
    prepare = type(fresh.renderer).prepare
    monkeypatch.setattr(type(fresh.renderer), "prepare", lambda self, surface: made.append(1) or prepare(self, surface))
    for seed in range(2):
        fresh.scenes([0, 3, 1], np.random.default_rng(seed))
    assert len(made) == len(tiny_exemplars.subjects) == 2


def test_base_colours_are_made_once(
    tiny_dataset: Path, tiny_exemplars: Exemplars, monkeypatch: pytest.MonkeyPatch
) -> None:
    held, made = stages(tiny_exemplars, tiny_dataset, 1), []
    base_colors = Subject.base_colors
    monkeypatch.setattr(Subject, "base_colors", lambda self, paint: made.append(1) or base_colors(self, paint))
    held.build([0, 3])
    made.clear()
    first, again = (held.scenes([3, 0, 3], np.random.default_rng(0)).base for _ in range(2))
    assert len(made) == 2
    assert torch.equal(first, again)
    paint = [tiny_exemplars.scenes[index].materials["body"] for index in (3, 0, 3)]
    torch.testing.assert_close(first.reshape(3, -1, 3)[:, 0], torch.tensor(paint))


def test_renderers_of_one_name_do_not_share_transports(tiny_dataset: Path, tiny_exemplars: Exemplars) -> None:
    ours = stages(tiny_exemplars, tiny_dataset, 1)
    plugin = type("NumpyRenderer", (type(ours.renderer.plugin),), {"__module__": "elsewhere"})()
    theirs = CheckedRenderer(plugin, "numpy")
    scene = tiny_exemplars.scenes[0]
    assert ours._key(scene) != replace(ours, renderer=theirs)._key(scene)
    assert ours._key(scene) == stages(tiny_exemplars, tiny_dataset, 1)._key(scene)
    assert ours._key(scene) == replace(ours, options={"device": "cpu"})._key(scene)
    assert ours._key(scene) != replace(ours, options={"epsilon": 0.1})._key(scene)


def test_stored_transports_are_read_again(dataset_copy: Path, tiny_exemplars: Exemplars) -> None:
    from svbrdfgan.scene.loader import SceneLoader

    exemplars = replace(tiny_exemplars, loader=SceneLoader(dataset_copy))
    first = stages(exemplars, dataset_copy, 1)
    first.build([0])
    again = replace(first, renderer=load_renderer("numpy"))
    again.build([0])
    assert again._surfaces._held == {}
    assert torch.equal(again._transports.held[0, 0].weight, first._transports.held[0, 0].weight)
    assert len(list((dataset_copy / "cache" / "transports").iterdir())) >= 1


def test_seen_texels_are_lit_and_learnable(tiny_dataset: Path, tiny_exemplars: Exemplars) -> None:
    seen = stages(tiny_exemplars, tiny_dataset, 1).seen(0)
    assert seen.shape == (32, 32)
    assert (seen >= 0).all()
    assert 0.02 < (seen > 0).float().mean() < 1
    assert (seen[~tiny_exemplars.subjects[0].learnable_texels] == 0).all()


def test_a_renderer_without_transport_is_refused(tiny_dataset: Path, tiny_exemplars: Exemplars) -> None:
    with pytest.raises(ConfigError, match="set rendering: online or choose another renderer"):
        CachedRendering(
            tiny_exemplars,
            perturbation(tiny_dataset),
            load_renderer("numpy", {"max_bounces": 2}),
            4,
            1,
            torch.device("cpu"),
        )
