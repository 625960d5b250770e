"""`ConfigSampler`: scenes drawn from what was declared."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from svbrdfgan.config.models import validate
from svbrdfgan.data.config import CameraDistribution, DatasetConfig, EnvironmentSource
from svbrdfgan.data.gather import gather_environments
from svbrdfgan.data.index import DatasetIndex
from svbrdfgan.data.sampler import ConfigSampler, EnvironmentAsset, MeshAsset
from svbrdfgan.errors import ConfigError
from svbrdfgan.io.environment import load_environment
from svbrdfgan.io.mesh import load_mesh
from svbrdfgan.scene.description import AssetRef, OrbitCamera
from svbrdfgan.scene.loader import SceneLoader

BOX = ((-1.0, 0.0, -2.5), (1.0, 1.5, 2.0))


@pytest.fixture
def sampler(dataset_data: Callable[..., dict[str, Any]]) -> Callable[..., ConfigSampler]:
    def make(**changes: Any) -> ConfigSampler:
        config = validate(DatasetConfig, dataset_data(**changes), "here")
        meshes = tuple(
            MeshAsset(name=f"car{n}", asset=AssetRef(path=f"car{n}.glb"), bounds=BOX, painted=("body", "door"))
            for n in range(4)
        )
        lights = tuple(
            EnvironmentAsset(name=f"sky{n}", asset=AssetRef(path=f"sky{n}.exr"), normalisation=2.0**n) for n in range(3)
        )
        return ConfigSampler(config, "train", meshes, lights)

    return make


def test_a_scene_does_not_depend_on_what_was_drawn_before(sampler: Callable[..., ConfigSampler]) -> None:
    one, other = sampler(), sampler()
    forward = [one.scene(n) for n in range(len(one))]
    backward = [other.scene(n) for n in reversed(range(len(other)))]
    assert forward == backward[::-1]
    assert len({scene.model_dump_json() for scene in forward}) == len(forward) == 12


def test_further_maps_are_drawn_and_nothing_else_changes(sampler: Callable[..., ConfigSampler]) -> None:
    plain, glossy = sampler(), sampler(maps={"roughness": {"uniform": [0.2, 0.5]}, "metallic": {"normal": [7, 1]}})
    drawn = [glossy.scene(n) for n in range(len(glossy))]
    assert len({scene.maps["roughness"] for scene in drawn}) == len(drawn)
    assert all(0.2 <= scene.maps["roughness"] <= 0.5 and scene.maps["metallic"] == 1.0 for scene in drawn)
    assert [scene.model_copy(update={"maps": {}}) for scene in drawn] == [plain.scene(n) for n in range(len(plain))]


def test_more_views_or_another_seed_are_other_scenes(sampler: Callable[..., ConfigSampler]) -> None:
    one, other = sampler(), sampler(seed=4)
    assert all(one.scene(n) != other.scene(n) for n in range(len(one)))


def test_close_ups_are_taken_from_the_viewpoints_of_the_mesh(sampler: Callable[..., ConfigSampler]) -> None:
    near = {"share": 0.5, "distance": {"log_uniform": [0.06, 0.24]}}
    splits = {"train": {"views": 100, "meshes": {"procedural": {"count": 1}}}}
    plain, declared = sampler(splits=splits), sampler(splits=splits, camera={"close_ups": near})
    places = ((1.0, 0.5, -1.0, 90.0, 10.0), (0.0, 1.5, 0.0, 0.0, 90.0))
    mixed = replace(declared, meshes=tuple(mesh.model_copy(update={"viewpoints": places}) for mesh in declared.meshes))
    whole, cameras = plain.scene(0).camera, [mixed.scene(index).camera for index in range(len(mixed))]
    close = [camera for camera in cameras if camera.target != whole.target]
    assert 0.4 < len(close) / len(cameras) < 0.6
    fit = whole.distance / mixed.config.camera.distance.sample(np.random.default_rng(0))
    shares = np.array([camera.distance for camera in close]) / fit
    assert shares.min() >= 0.06
    assert shares.max() <= 0.24
    assert 0.35 < (shares < 0.12).mean() < 0.65
    found = {(*camera.target, camera.azimuth_degrees, camera.elevation_degrees) for camera in close}
    assert found == {places[0], (*places[1][:4], 89.0)}, "a camera straight above has no direction that is up"
    assert {mixed.scene(index).window for index in range(len(mixed))} == {None}
    windowed = sampler(texture=64, splits=splits, camera={"close_ups": near | {"window": 32}})
    scenes = [replace(windowed, meshes=mixed.meshes).scene(index) for index in range(len(mixed))]
    assert [scene.camera for scene in scenes] == cameras
    assert {scene.window for scene in scenes if scene.camera in close} == {32}
    assert {scene.window for scene in scenes if scene.camera not in close} == {None}, "whole views have whole layers"
    with pytest.raises(ConfigError, match="close_ups are for data sets whose own cameras"):
        [declared.scene(index) for index in range(len(declared))]


def test_splits_draw_other_scenes(sampler: Callable[..., ConfigSampler]) -> None:
    train = sampler()
    held_out = ConfigSampler(train.config, "validation", train.meshes, train.environments)
    assert train.scene(0).camera != held_out.scene(0).camera


def test_a_split_may_have_cameras_of_its_own(
    sampler: Callable[..., ConfigSampler], dataset_data: Callable[..., dict[str, Any]]
) -> None:
    splits = dataset_data()["splits"]
    splits["train"] = {
        **splits["train"],
        "camera": {"azimuth_degrees": {"uniform": [0, 10]}, "elevation_degrees": 50.0},
    }
    plain, own = sampler(), sampler(splits=splits)
    cameras = [own.scene(index).camera for index in range(len(own))]
    assert all(camera.azimuth_degrees <= 10 and camera.elevation_degrees == 50 for camera in cameras)
    validation = [replace(each, split="validation").scene(0) for each in (plain, own)]
    assert validation[0] == validation[1]
    other = validate(CameraDistribution, {"elevation_degrees": 7.0}, "here")  # which fakes are drawn from
    assert own.draw_camera(own.mesh(0), np.random.default_rng(0), other).elevation_degrees == 7.0


def test_views_of_a_mesh_follow_each_other(sampler: Callable[..., ConfigSampler]) -> None:
    assert [sampler().mesh(n).name for n in range(12)] == [f"car{n}" for n in range(4) for _ in range(3)]


def test_ranges_are_kept_to_and_filled(sampler: Callable[..., ConfigSampler]) -> None:
    declared = sampler(
        camera={
            "azimuth_degrees": {"uniform": [-30, 30]},
            "elevation_degrees": {"uniform": [10, 20]},
            "distance": {"uniform": [1, 2]},
            "vertical_fov_degrees": {"choice": [30, 50]},
        },
        weathering={"amount": {"uniform": [0.25, 0.75]}, "seed": {"choice": [1, 2, 3]}},
        paint={"choice": [[1, 0, 0], [0, 1, 0]]},
        environment_rotation_degrees={"uniform": [90, 180]},
    )
    rng = np.random.default_rng(0)
    scenes = [declared.draw(declared.meshes[0], rng) for _ in range(400)]
    azimuth = np.array([(s.camera.azimuth_degrees + 180) % 360 - 180 for s in scenes])
    elevation = np.array([s.camera.elevation_degrees for s in scenes])
    amount = np.array([s.weathering.amount for s in scenes if s.weathering])
    rotation = np.array([s.environment.rotation_degrees for s in scenes])
    for values, low, high in ((azimuth, -30, 30), (elevation, 10, 20), (amount, 0.25, 0.75), (rotation, 90, 180)):
        assert low <= values.min() < low + 0.05 * (high - low)
        assert high - 0.05 * (high - low) < values.max() <= high
    assert {s.camera.vertical_fov_degrees for s in scenes} == {30.0, 50.0}
    assert {s.weathering.seed for s in scenes if s.weathering} == {1, 2, 3}
    assert {s.materials["body"] for s in scenes} == {(1.0, 0.0, 0.0), (0.0, 1.0, 0.0)}
    assert all(set(s.materials) == {"body", "door"} and s.materials["body"] == s.materials["door"] for s in scenes)
    assert len({s.seed for s in scenes}) == 400


def test_no_paint_leaves_the_meshes_own(sampler: Callable[..., ConfigSampler]) -> None:
    assert sampler(paint=None).scene(0).materials == {}


def test_what_no_scene_can_be_is_kept_out(sampler: Callable[..., ConfigSampler]) -> None:
    wild = {"normal": [0, 1000]}
    declared = sampler(
        camera=dict.fromkeys(("azimuth_degrees", "elevation_degrees", "distance", "vertical_fov_degrees"), wild),
        weathering={"amount": wild},
        environment_brightness=wild,
    )
    for index in range(len(declared)):
        scene = declared.scene(index)
        scene.camera.camera()
        assert scene.environment.scale > 0


@pytest.mark.parametrize("image", [[64, 64], [96, 32], [32, 96]])
@pytest.mark.parametrize("fov", [10, 35, 100])
def test_the_bounding_sphere_just_fits_at_distance_one(
    image: list[int], fov: int, sampler: Callable[..., ConfigSampler]
) -> None:
    """Tangent to the narrower pair of the frustum's sides, from every azimuth."""
    declared = sampler(image=image, camera={"distance": 1.0, "vertical_fov_degrees": fov})
    lower, upper = np.asarray(BOX)
    centre, radius = (lower + upper) / 2, np.linalg.norm(upper - lower) / 2
    for index in range(4):
        camera = declared.scene(index).camera.camera()
        assert camera.target == pytest.approx(centre)
        distance = np.linalg.norm(np.subtract(camera.origin, centre))
        half_height = camera.vertical_fov / 2
        half_width = math.atan(math.tan(half_height) * image[0] / image[1])
        assert math.asin(radius / distance) == pytest.approx(min(half_height, half_width))


def test_every_vertex_is_in_the_picture_at_distance_one(tiny_dataset: Any) -> None:
    plan = DatasetIndex.load(tiny_dataset)
    declared = plan.sampler("train")
    mesh = declared.meshes[0]
    positions = load_mesh(tiny_dataset / mesh.asset.path).positions
    far = validate(DatasetConfig, plan.config.model_dump(mode="json") | {"camera": {"distance": 1.0}}, "here").camera
    for seed in range(5):
        camera = declared.draw_camera(mesh, np.random.default_rng(seed), far).camera()
        x, y, z = camera.basis() @ (positions - np.asarray(camera.origin)).T
        tangent = math.tan(camera.vertical_fov / 2)
        assert (z < 0).all()
        assert max(np.abs(x / z).max(), np.abs(y / z).max()) <= tangent


def test_environments_are_brought_to_the_declared_brightness(tiny_dataset: Any) -> None:
    """Luminance, mean over the sphere, with rings weighted by the exact area between their edges."""
    sampler, loader = DatasetIndex.load(tiny_dataset).sampler("train"), SceneLoader(tiny_dataset, keep=False)
    for index in range(3):
        radiance = loader.view(sampler.scene(index)).environment.radiance.double()
        rows = len(radiance)
        edges = torch.cos(torch.arange(rows + 1, dtype=torch.float64) * math.pi / rows)
        luminance = radiance @ torch.tensor([0.2126, 0.7152, 0.0722], dtype=torch.float64)
        mean = (luminance.mean(dim=1) * (edges[:-1] - edges[1:])).sum() / 2
        assert float(mean) == pytest.approx(1.0, rel=1e-3)


def test_rooms_are_gathered_beside_skies(tmp_path: Path) -> None:
    sources = [{"procedural": {"count": 2, "seed": 1, **kind}} for kind in ({}, {"kind": "indoor"})]
    skies, rooms = (
        gather_environments(validate(EnvironmentSource, source, "here"), [], 16, tmp_path) for source in sources
    )
    assert [light.name for light in (*skies, *rooms)] == ["sky_100003", "sky_100004", "room_100003", "room_100004"]
    pictures = {load_environment(tmp_path / light.asset.path).numpy().tobytes() for light in (*skies, *rooms)}
    assert len(pictures) == 4


def test_brightness_scales_the_light(sampler: Callable[..., ConfigSampler]) -> None:
    dim, bright = (sampler(environment_brightness=b).scene(0).environment for b in (1.0, 3.0))
    assert bright.scale == pytest.approx(3 * dim.scale)
    assert dim.scale in {1.0, 2.0, 4.0}


def test_configurations_speak_degrees(tiny_dataset: Any) -> None:
    scene = DatasetIndex.load(tiny_dataset).sampler("train").scene(0)
    turned = scene.model_copy(
        update={
            "environment": scene.environment.model_copy(update={"rotation_degrees": 90.0}),
            "camera": OrbitCamera(azimuth_degrees=90.0, elevation_degrees=0.0, distance=2.0, vertical_fov_degrees=60.0),
        }
    )
    view = SceneLoader(tiny_dataset, keep=False).view(turned)
    assert view.environment.rotation == pytest.approx(math.pi / 2)
    assert view.camera.vertical_fov == pytest.approx(math.pi / 3)
    assert view.camera.origin == pytest.approx((2.0, 0.0, 0.0), abs=1e-12)
