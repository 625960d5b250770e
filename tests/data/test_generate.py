"""Making a data set: whole, checked, resumable, and the same whoever makes it."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from svbrdfgan.config.choices import PluginChoice
from svbrdfgan.config.distributions import Normal
from svbrdfgan.config.models import validate
from svbrdfgan.data import gather
from svbrdfgan.data.config import DatasetConfig
from svbrdfgan.data.estimate import estimate, preview
from svbrdfgan.data.exemplar_files import exemplar_paths, load_picture, save_exemplar
from svbrdfgan.data.exemplars import load_exemplars
from svbrdfgan.data.gather import gather_environments
from svbrdfgan.data.generate import generate, missing, render_scene
from svbrdfgan.data.index import Dataset, DatasetIndex
from svbrdfgan.data.make_index import make_index
from svbrdfgan.data.prebake import prebake
from svbrdfgan.errors import AssetError, ConfigError
from svbrdfgan.io.environment import load_environment
from svbrdfgan.io.gltf.surface_files import save_mesh_glb
from svbrdfgan.plugins import select
from svbrdfgan.plugins.select import resolve_renderer
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.vehicle import build_vehicle
from svbrdfgan.scene.description import Scene
from svbrdfgan.scene.loader import SceneLoader
from svbrdfgan.types import Rendering

Data = Callable[..., dict[str, Any]]
MAKE = """
import sys
from pathlib import Path
from svbrdfgan.data.prebake import prebake
from svbrdfgan.data.config import DatasetConfig
from svbrdfgan.data.generate import generate
if __name__ == "__main__":
    config = DatasetConfig.model_validate_json(Path(sys.argv[1]).read_text())
    generate(config, Path(sys.argv[2]), base=Path(), devices=int(sys.argv[3]), workers=int(sys.argv[4]))
"""


@pytest.fixture
def config(dataset_data: Data) -> DatasetConfig:
    return validate(DatasetConfig, dataset_data(), "here")


def contents(folder: Path) -> dict[Path, bytes]:
    """Pictures, scenes and lights, to the byte."""
    kept = ("train", "validation", "assets")
    return {p.relative_to(folder): p.read_bytes() for name in kept for p in (folder / name).rglob("*") if p.is_file()}


def assert_same(one: Path, other: Path) -> None:
    mine, its = contents(one), contents(other)
    assert mine.keys() == its.keys()
    assert [str(path) for path, content in mine.items() if content != its[path]] == []


def maker(config: DatasetConfig, folder: Path, devices: int = 1, workers: int = 1) -> list[str]:
    script, written = folder.with_suffix(".py"), folder.with_suffix(".config")
    script.write_text(MAKE)
    written.write_text(config.model_dump_json())
    return [sys.executable, str(script), str(written), str(folder), str(devices), str(workers)]


def test_every_exemplar_is_a_picture_and_its_scene(tiny_dataset: Path) -> None:
    for split, count in (("train", 6), ("validation", 2)):
        names = sorted(path.name for path in (tiny_dataset / split).iterdir())
        assert names == sorted(f"{n:06d}{suffix}" for n in range(count) for suffix in (".exr", ".json"))
    assert list(missing(DatasetIndex.load(tiny_dataset), tiny_dataset)) == []
    pictures = torch.stack([load_picture(exemplar_paths(tiny_dataset, "train", n)[0]) for n in range(6)])
    assert pictures.isfinite().all()
    coverage = pictures[..., 3].float()
    assert 0 <= coverage.min() < coverage.max() <= 1
    assert (pictures[..., :3][coverage == 0] == 0).all()
    assert all(0.02 < share < 0.9 for share in coverage.mean(dim=(1, 2)))


def test_scenes_are_those_of_the_sampler(tiny_dataset: Path) -> None:
    plan = DatasetIndex.load(tiny_dataset)
    for split in ("train", "validation"):
        for index in range(len(plan.sampler(split))):
            assert Scene.load(exemplar_paths(tiny_dataset, split, index)[1]) == plan.sampler(split).scene(index)


def test_assets_are_those_that_the_plan_names(tiny_dataset: Path) -> None:
    plan = DatasetIndex.load(tiny_dataset)
    refs = [a.asset for pool in (*plan.meshes.values(), *plan.environments.values()) for a in pool]
    assert len(refs) == 3 + 3 + 3
    for ref in refs:
        assert hashlib.sha256((tiny_dataset / ref.path).read_bytes()).hexdigest() == ref.sha256


def test_larger_environments_are_shrunk_and_keep_their_mean(
    tiny_dataset: Path, tmp_path: Path, config: DatasetConfig
) -> None:
    (whole, *_) = gather_environments(config.environments, [], 4096, tmp_path)
    (small, *_) = DatasetIndex.load(tiny_dataset).environments["train"]
    assert load_environment(tiny_dataset / small.asset.path).shape == (16, 32, 3)
    assert small.normalisation == pytest.approx(whole.normalisation, rel=0.02)


def test_a_picture_is_its_scene_rendered_again(tiny_dataset: Path) -> None:
    picture, record = exemplar_paths(tiny_dataset, "train", 4)
    scene = Scene.load(record)
    rendering = render_scene(SceneLoader(tiny_dataset, keep=False), resolve_renderer(scene.renderer)[0], scene)
    stored = load_picture(picture)
    assert torch.equal(stored[..., :3], rendering.image.half())
    assert torch.equal(stored[..., 3], rendering.coverage.half())


def test_only_what_is_missing_is_made(dataset_copy: Path, tiny_dataset: Path, config: DatasetConfig) -> None:
    removed = [("train", 1), ("train", 5), ("validation", 0)]
    for split, index in removed:
        exemplar_paths(dataset_copy, split, index)[1].unlink()  # type: ignore[arg-type]
    exemplar_paths(dataset_copy, "train", 5)[0].write_bytes(b"half a picture")
    before = {path: path.stat().st_mtime_ns for path in dataset_copy.rglob("0*.exr")}
    assert list(missing(DatasetIndex.load(dataset_copy), dataset_copy)) == removed
    generate(config, dataset_copy, base=Path())
    changed = {(p.parent.name, int(p.stem)) for p, then in before.items() if p.stat().st_mtime_ns != then}
    assert changed == set(removed)
    assert_same(dataset_copy, tiny_dataset)


@pytest.mark.full
def test_killed_in_the_middle_it_goes_on(tmp_path: Path, tiny_dataset: Path, config: DatasetConfig) -> None:
    folder = tmp_path / "dataset"
    process = subprocess.Popen(maker(config, folder), stderr=subprocess.DEVNULL)
    while process.poll() is None and len(list(folder.glob("train/0*.json"))) < 2:
        time.sleep(0.005)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    done = {path: path.stat().st_mtime_ns for path in folder.glob("*/0*.json")}
    assert 2 <= len(done) < 8, "the process was not killed in the middle"
    generate(config, folder, base=Path())
    assert all(path.stat().st_mtime_ns == then for path, then in done.items())
    assert_same(folder, tiny_dataset)
    leftovers = [path.name for path in folder.rglob(".*")]
    assert len(leftovers) <= 1, leftovers


@pytest.mark.full
def test_two_processes_make_the_same(tmp_path: Path, tiny_dataset: Path, config: DatasetConfig) -> None:
    folder = tmp_path / "dataset"
    done = subprocess.run(maker(config, folder, devices=2), capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert_same(folder, tiny_dataset)


@pytest.mark.full
def test_meshes_baked_ahead_make_the_same(tmp_path: Path, tiny_dataset: Path, config: DatasetConfig) -> None:
    folder = tmp_path / "dataset"
    done = subprocess.run(maker(config, folder, workers=2), capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert_same(folder, tiny_dataset)


@pytest.mark.full
def test_a_mesh_that_cannot_be_baked_ahead_is_told(dataset_copy: Path) -> None:
    plan = DatasetIndex.load(dataset_copy)
    scenes = [plan.sampler("train").scene(index) for index in (0, 4)]
    gone = dataset_copy / scenes[1].mesh.path
    gone.unlink()
    shutil.rmtree(dataset_copy / "cache")
    with pytest.raises(AssetError, match=f"{gone.name} is missing"):
        list(prebake(dataset_copy, [[scene] for scene in scenes], workers=2))


def test_processes_share_out_one_list(
    dataset_copy: Path, config: DatasetConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However late one of them starts: each mesh belongs to exactly one."""
    from types import SimpleNamespace

    from svbrdfgan.data import generate as module

    plan = DatasetIndex.load(dataset_copy)
    for record in dataset_copy.glob("*/0*.json"):
        record.unlink()
    dataset, choice = Dataset(dataset_copy, plan), PluginChoice(name="numpy")
    job = module._Job(dataset, choice, module._missing_by_mesh(dataset, None), 1)
    for rank in (0, 1):
        fabric = SimpleNamespace(device=torch.device("cpu"), world_size=2, global_rank=rank, barrier=lambda: None)
        module._render_on_device(fabric, job)  # type: ignore[arg-type]
    assert list(missing(plan, dataset_copy)) == []


def test_what_auto_chose_is_recorded(tmp_path: Path, dataset_data: Data, monkeypatch: pytest.MonkeyPatch) -> None:
    best = PluginChoice(name="warp", options={"device": "cpu"})
    monkeypatch.setattr(select, "select_renderer", lambda *_, **__: best)
    data = dataset_data(renderer="auto", image=[8, 8], spp=1, splits={"train": {"views": 1}})
    generate(validate(DatasetConfig, data, "here"), tmp_path, base=Path())
    chosen = Scene.load(exemplar_paths(tmp_path, "train", 0)[1]).renderer
    assert chosen == PluginChoice(name="warp"), "without the device, which another machine may lack"


@pytest.mark.parametrize("split", ["validation", "test"])
def test_a_mesh_that_is_trained_on_is_not_scored(split: str, tmp_path: Path, dataset_data: Data) -> None:
    shared = {"meshes": {"procedural": {"count": 2, "seed": 1}}, "views": 1}
    declared = validate(DatasetConfig, dataset_data(splits={split: shared}), "here")
    with pytest.raises(ConfigError, match=rf"'sedan_100003' is in the splits train and {split}.*another seed"):
        make_index(declared, tmp_path, Path())
    assert not (tmp_path / "dataset.json").exists()


def test_meshes_of_splits_with_close_ups_have_viewpoints(tmp_path: Path, dataset_data: Data) -> None:
    data = dataset_data()
    data["splits"]["train"]["camera"] = {"close_ups": {}}
    plan = make_index(validate(DatasetConfig, data, "here"), tmp_path, tmp_path)
    assert all(len(mesh.viewpoints) == 64 for mesh in plan.meshes["train"])
    assert not any(mesh.viewpoints for split, pool in plan.meshes.items() if split != "train" for mesh in pool)
    for mesh in plan.meshes["train"]:
        lower, upper = np.array(mesh.bounds)
        points, angles = np.split(np.array(mesh.viewpoints), [3], axis=1)
        assert (points > lower - 1e-4).all()
        assert (points < upper + 1e-4).all()
        assert ((angles >= 0.0) & (angles <= (360.0, 90.0))).all()
    assert DatasetIndex.load(tmp_path) == plan


def test_several_processes_gather_the_same_meshes(
    tmp_path: Path, dataset_data: Data, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gather, "_WORTH_A_PROCESS", 1)
    data = dataset_data(splits={"train": {"meshes": {"procedural": {"count": 2}}, "camera": {"close_ups": {}}}})
    declared = validate(DatasetConfig, data, "here")
    alone, together = (make_index(declared, tmp_path / str(n), tmp_path, workers=n) for n in (1, 2))
    assert together == alone


def test_close_ups_of_what_nobody_sees_are_told(tmp_path: Path, dataset_data: Data) -> None:
    data = dataset_data(learnable={"include": ["tyre*"]}, camera={"close_ups": {}})
    ground = tmp_path / "ground.obj"
    ground.write_text(
        "v -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1\nv -9 1 -9\nv 9 1 -9\nv 9 1 9\nv -9 1 9\n"
        "o tyre\nf 1 3 2\nf 1 4 3\no roof\nf 5 7 6\nf 5 8 7\n"
    )
    data["splits"] = {"train": {"meshes": {"files": [str(ground)]}}}
    with pytest.raises(AssetError, match="no camera sees a learnable part of the mesh 'ground' from near"):
        make_index(validate(DatasetConfig, data, "here"), tmp_path / "out", tmp_path)


def test_files_that_match_later_are_told(tmp_path: Path, dataset_data: Data, caplog: pytest.LogCaptureFixture) -> None:
    vehicle = build_vehicle(sample_vehicle("van", 5))
    save_mesh_glb(tmp_path / "cars" / "one.glb", vehicle)
    data = dataset_data(splits={"train": {"meshes": {"files": ["cars/*.glb"], "procedural": None}}})
    declared = validate(DatasetConfig, data, "here")
    plan = make_index(declared, tmp_path / "data", tmp_path)
    assert make_index(declared, tmp_path / "data", tmp_path) == plan
    assert not caplog.messages
    save_mesh_glb(tmp_path / "cars" / "two.glb", vehicle)
    assert make_index(declared, tmp_path / "data", tmp_path) == plan
    assert "was begun without two, which train files match now" in caplog.text
    shutil.rmtree(tmp_path / "cars")
    assert make_index(declared, tmp_path / "data", tmp_path) == plan, "the folder has copies"


def test_another_configuration_is_refused(dataset_copy: Path, dataset_data: Data) -> None:
    other = validate(DatasetConfig, dataset_data(seed=4), "here")
    with pytest.raises(ConfigError, match=r"another configuration \(seed 3, not 4\); choose another folder") as caught:
        generate(other, dataset_copy, base=Path())
    assert len(str(caught.value).splitlines()) == 1


def test_what_made_nothing_can_be_corrected_in_its_folder(tmp_path: Path, dataset_data: Data) -> None:
    data = dataset_data(image=[8, 8], spp=1, splits={"train": {"views": 1}})
    wrong = validate(DatasetConfig, data | {"learnable": {"include": ["Bodyy"]}}, "here")
    with pytest.raises(AssetError, match="no visible part is learnable"):
        generate(wrong, tmp_path, base=Path())
    right = validate(DatasetConfig, data, "here")
    assert generate(right, tmp_path, base=Path()).config == right
    with pytest.raises(ConfigError, match=r"another configuration \(learnable\.include .*, not .*Bodyy"):
        generate(wrong, tmp_path, base=Path())


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"camera": {"distance": -1}}, "camera.distance: -1.0 is not allowed; wanted numbers at least 0.05"),
        (
            {"camera": {"elevation_degrees": {"uniform": [5, 200]}}},
            "200.0 is not allowed; wanted numbers from -89",
        ),
        ({"camera": {"vertical_fov_degrees": {"choice": [35, 0]}}}, "wanted numbers from 1 to 170"),
        ({"environment_brightness": -1}, "environment_brightness: -1.0 is not allowed"),
        ({"weathering": {"amount": 2}}, "weathering.amount: 2.0 is not allowed; wanted numbers from 0 to 1"),
        ({"paint": [2, 0, 0]}, "paint: (2.0, 0.0, 0.0) is not allowed"),
        ({"maps": {"roughness": 7}}, "maps.roughness: 7.0 is not allowed"),
    ],
)
def test_numbers_that_no_picture_could_have_are_told(changes: dict[str, Any], said: str, dataset_data: Data) -> None:
    with pytest.raises(ConfigError) as caught:
        validate(DatasetConfig, dataset_data(**changes), "here")
    (line,) = str(caught.value).splitlines()
    assert said in line


def test_tails_of_a_normal_distribution_are_clamped(dataset_data: Data) -> None:
    declared = dataset_data(camera={"elevation_degrees": {"normal": [80.0, 40.0]}})
    assert validate(DatasetConfig, declared, "here").camera.elevation_degrees == Normal(normal=(80.0, 40.0))


def test_a_changed_environment_is_told(dataset_copy: Path, config: DatasetConfig) -> None:
    record = exemplar_paths(dataset_copy, "train", 0)[1]
    light = dataset_copy / Scene.load(record).environment.asset.path
    light.write_bytes(light.read_bytes() + b"x")
    record.unlink()
    with pytest.raises(AssetError, match=rf"{light.name} is not the file .* content hash differs"):
        generate(config, dataset_copy, base=Path())


@pytest.mark.parametrize("damage", ["change", "remove"])
def test_a_changed_or_missing_mesh_is_told(damage: str, dataset_copy: Path) -> None:
    scene = Scene.load(exemplar_paths(dataset_copy, "train", 0)[1])
    mesh = dataset_copy / scene.mesh.path
    mesh.write_bytes(mesh.read_bytes() + b"x") if damage == "change" else mesh.unlink()
    with pytest.raises(AssetError, match=f"{mesh.name} is (missing|not the file)"):
        SceneLoader(dataset_copy, keep=False).subject(scene)


def test_environments_shared_by_splits_are_written_once(tmp_path: Path, config: DatasetConfig) -> None:
    """EXR files carry the time of their writing: written again, they would be other files."""
    (first, *_) = gather_environments(config.environments, [], 16, tmp_path)
    written = (tmp_path / first.asset.path).stat().st_mtime_ns
    (again, *_) = gather_environments(config.environments, [], 16, tmp_path)
    assert again == first
    assert (tmp_path / first.asset.path).stat().st_mtime_ns == written


def a_car(path: Path, seed: int) -> None:
    save_mesh_glb(path, build_vehicle(sample_vehicle("sedan", seed)))


def test_meshes_come_from_patterns(tmp_path: Path, dataset_data: Data) -> None:
    for name, seed in (("b", 1), ("a", 2)):
        a_car(tmp_path / "cars" / f"{name}.glb", seed)
    data = dataset_data()
    data["splits"] = {"train": {"meshes": {"files": ["cars/*.glb"]}}}
    plan = make_index(validate(DatasetConfig, data, "here"), tmp_path / "out", tmp_path)
    assert [mesh.name for mesh in plan.meshes["train"]] == ["a", "b"]
    assert all((tmp_path / "out" / mesh.asset.path).is_file() for mesh in plan.meshes["train"])


def test_a_pattern_without_a_match_is_told(tmp_path: Path, dataset_data: Data) -> None:
    data = dataset_data()
    data["splits"] = {"train": {"meshes": {"files": ["cars/*.glb"]}}}
    with pytest.raises(ConfigError, match=r"splits\.train\.meshes\.files: no file matches 'cars/\*\.glb'"):
        make_index(validate(DatasetConfig, data, "here"), tmp_path / "out", tmp_path)
    data = dataset_data(environments={"files": ["*.hdr"]})
    with pytest.raises(ConfigError, match=r"environments\.files: no file matches '\*\.hdr'"):
        make_index(validate(DatasetConfig, data, "here"), tmp_path / "out", tmp_path)
    assert not (tmp_path / "out").exists()
    for split in data["splits"].values():
        split["environments"] = {"procedural": {"count": 1}}
    make_index(
        validate(DatasetConfig, data, "here"), tmp_path / "out", tmp_path
    )  # what no split takes need not be there


def test_a_run_is_no_place_for_a_data_set(tmp_path: Path, config: DatasetConfig) -> None:
    (tmp_path / "config.json").write_text("{}")
    with pytest.raises(ConfigError, match="holds a run"):
        make_index(config, tmp_path, tmp_path)
    assert len(list(tmp_path.iterdir())) == 1


def test_what_is_no_pattern_is_told(tmp_path: Path, dataset_data: Data) -> None:
    data = dataset_data(splits={"train": {"meshes": {"files": [""]}}})
    with pytest.raises(ConfigError, match=r"'' is not a shell pattern of files"):
        make_index(validate(DatasetConfig, data, "here"), tmp_path / "out", tmp_path)


@pytest.mark.parametrize("split", ["train", "validation"])
def test_two_meshes_of_one_name_are_told(split: str, tmp_path: Path, dataset_data: Data) -> None:
    """Within a split, and across splits."""
    for folder, seed in (("one", 1), ("two", 2)):
        a_car(tmp_path / folder / "car.glb", seed)
    data = dataset_data()
    data["splits"] = {"train": {"meshes": {"files": ["one/car.glb"]}}}
    if split == "train":
        data["splits"]["train"]["meshes"]["files"].append("two/car.glb")
    else:
        data["splits"]["validation"] = {"meshes": {"files": ["two/car.glb"]}}
    with pytest.raises(ConfigError, match=r"share the name.*'car'.*rename"):
        make_index(validate(DatasetConfig, data, "here"), tmp_path / "out", tmp_path)


def test_another_environment_never_replaces_one_of_a_data_set(dataset_copy: Path, config: DatasetConfig) -> None:
    (light, *_) = DatasetIndex.load(dataset_copy).environments["train"]
    with pytest.raises(ConfigError, match=f"another environment of the name '{light.name}'"):
        gather_environments(config.environments, [], 8, dataset_copy)
    SceneLoader(dataset_copy).file(light.asset)


def test_no_data_set_is_told(tmp_path: Path) -> None:
    with pytest.raises(AssetError, match=r"is not a data set: it has no dataset\.json"):
        DatasetIndex.load(tmp_path)


@pytest.mark.parametrize("text", ["{", "[]", '{"format": "svbrdfgan data set 0"}'])
def test_a_plan_of_another_kind_is_told(tmp_path: Path, text: str) -> None:
    (tmp_path / "dataset.json").write_text(text)
    with pytest.raises(AssetError, match=r"dataset\.json") as caught:
        DatasetIndex.load(tmp_path)
    assert len(str(caught.value).splitlines()) == 1


def test_a_damaged_plan_names_the_key(dataset_copy: Path) -> None:
    plan = json.loads((dataset_copy / "dataset.json").read_text())
    plan["config"]["spp"] = "many"
    (dataset_copy / "dataset.json").write_text(json.dumps(plan))
    with pytest.raises(ConfigError, match=r"config\.spp"):
        load_exemplars(Dataset.open(dataset_copy), "train")


def change(path: Path, change: Callable[[Any], Any]) -> None:
    record = json.loads(path.read_text())
    path.write_text(json.dumps(change(record)))


def under(record: Any, *keys: str, value: Any) -> Any:
    """The record with another value at the end of these keys."""
    return record | {keys[0]: under(record[keys[0]], *keys[1:], value=value) if keys[1:] else value}


@pytest.mark.parametrize(
    ("keys", "value", "said"),
    [
        (("meshes",), {}, "names no meshes or no environments of the split 'train'"),
        (("environments",), {"train": []}, "names no meshes or no environments of the split 'train'"),
        (("config", "splits"), {}, "splits needs 'train'"),
        (("config", "splits", "train", "views"), 10**9, "at most 1000000"),
        (("config", "spp"), 10**9, "at most 65536"),
    ],
)
def test_a_plan_that_cannot_be_is_told_at_once(
    keys: tuple[str, ...], value: Any, said: str, dataset_copy: Path
) -> None:
    change(dataset_copy / "dataset.json", lambda plan: under(plan, *keys, value=value))
    with pytest.raises(ConfigError, match=said) as caught:
        Dataset.open(dataset_copy)
    assert len(str(caught.value).splitlines()) == 1


def test_very_many_missing_exemplars_are_counted_at_once(dataset_copy: Path) -> None:
    change(
        dataset_copy / "dataset.json", lambda plan: under(plan, "config", "splits", "train", "views", value=1_000_000)
    )
    with pytest.raises(AssetError, match=r"is not finished: \d+ of \d+000000 train exemplars are missing"):
        load_exemplars(Dataset.open(dataset_copy), "train")


@pytest.mark.parametrize("key", ["width", "height", "texture"])
def test_a_record_of_another_size_is_told(key: str, dataset_copy: Path) -> None:
    change(dataset_copy / "train" / "000001.json", lambda record: record | {key: 64})
    with pytest.raises(AssetError, match=rf"000001\.json has {key} 64, and its data set 32; delete it"):
        load_exemplars(Dataset.open(dataset_copy), "train")


def test_a_record_with_other_maps_is_told(dataset_copy: Path) -> None:
    change(dataset_copy / "train" / "000001.json", lambda record: record | {"maps": {"roughness": 0.5}})
    with pytest.raises(AssetError, match=r"000001\.json has other maps than its data set; delete it"):
        load_exemplars(Dataset.open(dataset_copy), "train")


def test_a_picture_of_another_size_is_told(dataset_copy: Path) -> None:
    save_exemplar(dataset_copy / "train" / "000001.exr", Rendering(torch.zeros(16, 32, 3), torch.zeros(16, 32)))
    with pytest.raises(AssetError, match=r"000001\.exr has another size than its scene; delete it"):
        load_exemplars(Dataset.open(dataset_copy), "train")


def test_an_estimate_is_near_and_leaves_nothing(tmp_path: Path, tiny_dataset: Path, config: DatasetConfig) -> None:
    needs = estimate(config, tmp_path)
    assert (needs.exemplars, needs.meshes) == (8, 3)
    stored = sum(
        file.stat().st_size for file in tiny_dataset.rglob("*") if file.is_file() and "transports" not in file.parts
    )
    assert stored / 2 < needs.disk < stored * 2
    assert 0 < needs.seconds < 600
    assert needs.memory > needs.transport > 0
    assert list(tmp_path.iterdir()) == []


def test_an_estimate_counts_the_layers_that_differ(dataset_data: Data) -> None:
    one, many = (
        estimate(validate(DatasetConfig, dataset_data(spp=1, weathering={"amount": amount}), "here"), Path())
        for amount in (1.0, {"uniform": [0.5, 1.0]})
    )
    layer, more = 32 * 32 * 4 * 4, many.exemplars - many.meshes
    assert more * layer <= many.memory - one.memory < more * (layer + 4096)


def test_a_preview_is_the_first_exemplar_beside_its_clean_twin(tiny_dataset: Path, config: DatasetConfig) -> None:
    shown = preview(config, Path())
    assert shown.shape == (32, 64, 3)
    stored = load_picture(exemplar_paths(tiny_dataset, "train", 0)[0]).float()
    expected = stored[..., :3] + 0.18 * (1 - stored[..., 3:])
    torch.testing.assert_close(shown[:, :32], expected, rtol=2e-3, atol=2e-3)
    assert not torch.equal(shown[:, :32], shown[:, 32:])
    bare = stored[..., 3] == 0
    assert torch.equal(shown[:, :32][bare], shown[:, 32:][bare])


def test_exemplars_may_have_several_recipes(dataset_data: Data, tmp_path: Path) -> None:
    weathering = {"recipe": {"choice": ["rust", "dust"]}, "amount": {"uniform": [0.5, 1]}, "seed": {"uniform": [0, 99]}}
    declared = validate(DatasetConfig, dataset_data(weathering=weathering), "here")
    index = generate(declared, tmp_path, base=Path())
    found = [Scene.load(path).weathering for path in sorted(tmp_path.glob("train/*.json"))]
    assert {weathering.recipe for weathering in found} == {"rust", "dust"}
    assert len({weathering.seed for weathering in found}) > 1
    assert DatasetIndex.load(tmp_path) == index


def test_options_must_suit_every_recipe(dataset_data: Data, tmp_path: Path) -> None:
    weathering = {"recipe": {"choice": ["rust", "dust"]}, "options": {"bleed": 0.5}}
    declared = validate(DatasetConfig, dataset_data(weathering=weathering), "here")
    with pytest.raises(ConfigError, match=r"weathering dust.*bleed"):
        generate(declared, tmp_path, base=Path())
