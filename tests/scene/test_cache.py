"""Subjects, layers and exemplars on disk and in memory."""

from __future__ import annotations

import hashlib
import json
import math
import shutil
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors import safe_open
from torch import Tensor

from svbrdfgan.data.exemplar_files import exemplar_paths, load_picture
from svbrdfgan.data.exemplars import Exemplars, load_exemplars
from svbrdfgan.data.index import Dataset
from svbrdfgan.errors import AssetError
from svbrdfgan.io.tensors import save_tensors
from svbrdfgan.rendering.compositing import composite
from svbrdfgan.scene import loader as loader_module
from svbrdfgan.scene.cache import (
    load_layer,
    load_mesh_maps,
    load_subject,
    save_layer,
    save_mesh_maps,
    save_subject,
)
from svbrdfgan.scene.description import Scene, SceneWeathering
from svbrdfgan.scene.loader import SceneLoader, subject_key
from svbrdfgan.types import Layer
from svbrdfgan.weathering.mesh_maps import MeshMaps
from svbrdfgan.weathering.survey import find_site

TRASH = [b"", b"\x08\x00\x00\x00\x00\x00\x00\x00{broken}", b"x" * 5000]


def assert_equal_records(one: object, other: object) -> None:
    for field in fields(one):  # type: ignore[arg-type]
        mine, its = getattr(one, field.name), getattr(other, field.name)
        if isinstance(mine, Tensor):
            assert torch.equal(mine, its), field.name
        elif isinstance(mine, np.ndarray):
            assert isinstance(its, np.ndarray), field.name
            assert mine.dtype == its.dtype, field.name
            np.testing.assert_array_equal(mine, its, err_msg=field.name)
        elif field.name != "parts":
            assert mine == its, field.name


def test_a_subject_returns_as_it_was(tiny_exemplars: Exemplars, tmp_path: Path) -> None:
    subject = tiny_exemplars.subjects[0]
    save_subject(tmp_path / "deep" / "car.safetensors", subject)
    loaded = load_subject(tmp_path / "deep" / "car.safetensors", 32)
    assert_equal_records(subject.surface, loaded.surface)
    assert_equal_records(subject.buffer, loaded.buffer)
    assert loaded.learnable == subject.learnable
    assert all(torch.equal(a, b) for a, b in zip(subject.base, loaded.base, strict=True))
    names = [[(p.name, p.hidden_half_of, p.base_color) for p in s.surface.parts] for s in (subject, loaded)]
    assert names[0] == names[1]
    assert torch.equal(subject.geometry, loaded.geometry)


def test_a_layer_returns_as_it_was(tmp_path: Path) -> None:
    layer = Layer(torch.rand(8, 8, 5), ("roughness",))
    save_layer(tmp_path / "layer.safetensors", layer)
    (tmp_path / "other").touch()
    assert len({path.stat().st_mode for path in tmp_path.iterdir()}) == 1, "readable by whom others are"
    again = load_layer(tmp_path / "layer.safetensors", 8)
    assert torch.equal(again.values, layer.values)
    assert again.maps == layer.maps


@pytest.mark.parametrize("load", [load_layer, load_subject])
@pytest.mark.parametrize("content", TRASH)
def test_damage_is_one_sentence(load: Callable[[Path, int], object], content: bytes, tmp_path: Path) -> None:
    (tmp_path / "file.safetensors").write_bytes(content)
    with pytest.raises(AssetError, match=r"file\.safetensors") as caught:
        load(tmp_path / "file.safetensors", 4)
    assert len(str(caught.value).splitlines()) == 1


def test_one_kind_is_not_taken_for_the_other(tmp_path: Path) -> None:
    save_layer(tmp_path / "layer.safetensors", Layer(torch.rand(4, 4, 4)))
    with pytest.raises(AssetError, match=r"layer\.safetensors is not a 'svbrdfgan subject 2' file"):
        load_subject(tmp_path / "layer.safetensors", 4)


def test_a_file_that_lacks_something_is_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "file.safetensors"
    save_tensors(path, "svbrdfgan layer 2", {"other": torch.zeros(2)}, {})
    with pytest.raises(AssetError, match=r"file\.safetensors cannot be read \(it has no 'layer'\); delete it"):
        load_layer(path, 4)
    save_tensors(path, "svbrdfgan subject 2", {}, {"header": "{"})
    with pytest.raises(AssetError, match=r"file\.safetensors cannot be read .*delete it"):
        load_subject(path, 4)


def doctor(path: Path, **changes: Callable[[Any], Any]) -> None:
    """Changes tensors of a file, or, as `header`, what a subject's file says in words."""
    with safe_open(path, framework="pt") as file:
        words, tensors = file.metadata(), {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    for name, change in changes.items():
        if name == "header":
            words["header"] = json.dumps(change(json.loads(words["header"])))
        else:
            tensors[name.replace("__", ".")] = change(tensors[name.replace("__", ".")]).contiguous()
    save_tensors(path, words["format"], tensors, words)


DOCTORED: dict[str, Callable[[Any], Any]] = {
    "flat": lambda values: values.flatten(),
    "three channels": lambda values: values[..., :3],
    "smaller": lambda values: values[:2],
    "bytes": lambda values: (255 * values).byte(),
    "not finite": lambda values: values * math.nan,
}


@pytest.mark.parametrize("change", DOCTORED.values(), ids=DOCTORED)
def test_a_doctored_layer_is_one_sentence(change: Callable[[Any], Any], tmp_path: Path) -> None:
    save_layer(tmp_path / "layer.safetensors", Layer(torch.rand(4, 4, 4)))
    doctor(tmp_path / "layer.safetensors", layer=change)
    with pytest.raises(
        AssetError, match=r"layer\.safetensors cannot be read \(.*\); delete it, and it is made again"
    ) as caught:
        load_layer(tmp_path / "layer.safetensors", 4)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(
    "changes",
    [
        {"surface__faces": lambda faces: faces.float()},
        {"surface__faces": lambda faces: faces + 10**6},
        {"surface__positions": lambda positions: positions * math.nan},
        {"buffer__position": lambda position: position[:4]},
        {"buffer__position": lambda position: position * math.inf},
        {"buffer__part": lambda part: part + 100},
        {"buffer__face": lambda face: face + 10**6},
        {"buffer__face": lambda face: face.float()},
        {"base__0": lambda base: base.expand(2, 2, 3)},
        {"header": lambda header: header | {"learnable": [99]}},
        {"header": lambda header: header | {"learnable": [0, 0]}},
        {"header": lambda header: header | {"learnable": "abc"}},
        {"header": lambda header: header | {"parts": None}},
        {"header": lambda header: None},
    ],
)
def test_a_doctored_subject_is_one_sentence(
    changes: dict[str, Callable[[Any], Any]], tiny_exemplars: Exemplars, tmp_path: Path
) -> None:
    path = tmp_path / "car.safetensors"
    save_subject(path, tiny_exemplars.subjects[0])
    load_subject(path, 32)
    doctor(path, **changes)
    with pytest.raises(
        AssetError, match=r"car\.safetensors cannot be read \(.*\); delete it, and it is made again"
    ) as caught:
        load_subject(path, 32)
    assert len(str(caught.value).splitlines()) == 1


def test_mesh_maps_of_another_size_are_refused(tmp_path: Path) -> None:
    maps = MeshMaps(*torch.rand(5, 4, 4, dtype=torch.float64))
    save_mesh_maps(tmp_path / "maps.safetensors", maps)
    assert torch.equal(load_mesh_maps(tmp_path / "maps.safetensors", 4).crease, maps.crease)
    with pytest.raises(AssetError, match=r"maps\.safetensors cannot be read .*; delete it"):
        load_mesh_maps(tmp_path / "maps.safetensors", 8)


def test_a_missing_file_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(AssetError, match=r"none\.safetensors"):
        load_layer(tmp_path / "none.safetensors", 4)


def test_exemplars_are_what_is_stored(tiny_dataset: Path, tiny_exemplars: Exemplars) -> None:
    assert len(tiny_exemplars) == 6
    assert len(tiny_exemplars.subjects) == 2
    assert tiny_exemplars.subject_of.tolist() == [0, 0, 0, 1, 1, 1]
    assert tiny_exemplars.views_of(1) == [3, 4, 5]
    for n in range(6):
        picture, record = exemplar_paths(tiny_dataset, "train", n)
        assert tiny_exemplars.scenes[n] == Scene.load(record)
        assert torch.equal(tiny_exemplars.images[n], load_picture(picture)[..., :3])
        assert torch.equal(tiny_exemplars.coverage[n], load_picture(picture)[..., 3])
        assert tiny_exemplars.subject(n) is tiny_exemplars.subjects[n // 3]


def test_layers_are_those_of_the_subject(tiny_exemplars: Exemplars) -> None:
    """The recipe's seed is fixed, so that the layer is a function of the geometry."""
    first = [layer.values for layer in tiny_exemplars.layers[:3] if layer is not None]
    assert len(first) == 3
    assert torch.equal(first[0], first[2])
    other = tiny_exemplars.layers[3]
    assert other is not None
    assert not torch.equal(first[0], other.values)
    assert first[0].min() >= 0
    assert first[0].max() <= 1


def test_an_unfinished_data_set_is_told(dataset_copy: Path) -> None:
    exemplar_paths(dataset_copy, "train", 2)[1].unlink()
    with pytest.raises(AssetError, match="not finished: 1 of 6 train exemplars are missing"):
        load_exemplars(Dataset.open(dataset_copy), "train")


def test_a_split_that_is_not_there_is_told(tiny_dataset: Path) -> None:
    with pytest.raises(AssetError, match="has no split 'test'; it has train, validation"):
        load_exemplars(Dataset.open(tiny_dataset), "test")


@pytest.mark.parametrize("content", TRASH)
def test_a_damaged_picture_is_one_sentence(content: bytes, dataset_copy: Path) -> None:
    exemplar_paths(dataset_copy, "train", 2)[0].write_bytes(content)
    with pytest.raises(AssetError, match=r"000002\.exr") as caught:
        load_exemplars(Dataset.open(dataset_copy), "train")
    assert len(str(caught.value).splitlines()) == 1


def test_a_damaged_cache_is_one_sentence(dataset_copy: Path) -> None:
    for path in (dataset_copy / "cache" / "subjects").iterdir():
        path.write_bytes(b"x" * 100)
    with pytest.raises(AssetError, match="delete it, and it is made again") as caught:
        load_exemplars(Dataset.open(dataset_copy), "train")
    assert len(str(caught.value).splitlines()) == 1


def test_a_cache_that_is_gone_is_made_again(dataset_copy: Path, tiny_exemplars: Exemplars) -> None:
    shutil.rmtree(dataset_copy / "cache")
    again = load_exemplars(Dataset.open(dataset_copy), "train")
    assert torch.equal(again.subjects[1].geometry, tiny_exemplars.subjects[1].geometry)
    one, other = again.layers[5], tiny_exemplars.layers[5]
    assert one is not None
    assert other is not None
    assert torch.equal(one.values, other.values)
    assert (dataset_copy / "cache").is_dir()


def test_a_studio_that_keeps_nothing_writes_nothing(dataset_copy: Path, tiny_exemplars: Exemplars) -> None:
    shutil.rmtree(dataset_copy / "cache")
    loader = SceneLoader(dataset_copy, keep=False)
    subject = loader.subject(tiny_exemplars.scenes[0])
    assert loader.subject(tiny_exemplars.scenes[1]) is subject
    assert not (dataset_copy / "cache").exists()


def test_a_subject_is_shared_by_scenes_that_differ_in_light_and_paint(tiny_exemplars: Exemplars) -> None:
    scene = tiny_exemplars.scenes[0]
    painted = scene.model_copy(
        update={"materials": {}, "seed": 99, "spp": 1, "environment": tiny_exemplars.scenes[1].environment}
    )
    assert subject_key(painted) == subject_key(scene)
    assert subject_key(scene.model_copy(update={"texture": 64})) != subject_key(scene)


def test_what_is_not_weathered_has_no_layer(tiny_dataset: Path, tiny_exemplars: Exemplars) -> None:
    clean = tiny_exemplars.scenes[0].model_copy(update={"weathering": None})
    assert SceneLoader(tiny_dataset).layer(clean) is None


def test_paint_covers_the_named_parts_alone(tiny_exemplars: Exemplars) -> None:
    subject = tiny_exemplars.subjects[0]
    names = [part.name for part in subject.surface.parts]
    body, glass = names.index("body"), names.index("glass")
    colors = subject.base_colors({"body": (0.9, 0.1, 0.2)})
    assert torch.equal(colors[body], torch.tensor([0.9, 0.1, 0.2]))
    assert torch.equal(colors[names.index("body (hidden)")], colors[body])
    assert torch.equal(colors[glass], subject.base[glass])


def test_further_maps_are_of_learnable_parts_and_their_hidden_halves(tiny_exemplars: Exemplars) -> None:
    subject, layer = tiny_exemplars.subjects[0], Layer(torch.rand(32, 32, 5), ("roughness",))
    names = [part.name for part in subject.surface.parts]
    bare, made = (subject.materials(over, {"roughness": 0.25}) for over in (None, layer))
    for part, name in enumerate(names):
        if name in ("body", "body (hidden)"):
            assert torch.equal(bare[part].maps["roughness"], torch.tensor([0.25]))
        else:
            assert bare[part].maps.keys() == made[part].maps.keys() == {"base_color"}
    alpha = layer["alpha"]
    rough = made[names.index("body")].maps["roughness"]
    torch.testing.assert_close(rough, 0.25 * (1 - alpha) + layer["roughness"] * alpha)
    assert torch.equal(made[names.index("body (hidden)")].maps["roughness"], torch.tensor([0.25]))
    assert torch.equal(made[names.index("body")].base_color, subject.materials(Layer(layer.rgba))[0].base_color)


def test_files_that_know_of_no_further_maps_are_read(dataset_copy: Path, tiny_exemplars: Exemplars) -> None:
    """As they were written before there were any; nothing that is kept is made anew."""
    for path in dataset_copy.rglob("*.json"):
        path.write_text(json.dumps(without_maps(json.loads(path.read_text()))))
    kept = {path: path.stat().st_mtime_ns for path in (dataset_copy / "cache").rglob("*")}
    again = load_exemplars(Dataset.open(dataset_copy), "train")
    assert again.scenes == tiny_exemplars.scenes
    assert kept == {path: path.stat().st_mtime_ns for path in (dataset_copy / "cache").rglob("*")}


def without_maps(data: dict[str, Any]) -> dict[str, Any]:
    inner = {"config": without_maps(data["config"])} if "config" in data else {}
    assert inner or data["maps"] == {}
    return {name: value for name, value in data.items() if name != "maps"} | inner


def test_layers_are_read_when_they_are_looked_at(
    tiny_dataset: Path, tiny_exemplars: Exemplars, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And let go of, so that a data set in which each exemplar has its own fits in memory."""
    known = [tiny_exemplars.layers[index] for index in range(6)]  # whatever test was first to look at them
    read: list[Path] = []
    monkeypatch.setattr(loader_module, "load_layer", lambda path, side: read.append(path) or load_layer(path, side))
    monkeypatch.setattr(loader_module, "KEPT", 1)
    exemplars = load_exemplars(Dataset.open(tiny_dataset), "train")
    assert all(map(exemplars.weathered, range(6)))
    assert read == []
    for index in (0, 1, 3, 0):
        one, other = exemplars.layers[index], known[index]
        assert one is not None
        assert other is not None
        assert torch.equal(one.values, other.values)
    assert len(read) == 3


def test_a_surface_is_surveyed_once_for_all_its_layers(
    tiny_dataset: Path, tiny_exemplars: Exemplars, monkeypatch: pytest.MonkeyPatch
) -> None:
    surveyed: list[object] = []
    monkeypatch.setattr(loader_module, "find_site", lambda *of, **words: surveyed.append(of) or find_site(*of, **words))
    loader, scene = SceneLoader(tiny_dataset, keep=False), tiny_exemplars.scenes[0]
    assert isinstance(scene.weathering, SceneWeathering)
    thin = scene.model_copy(update={"weathering": scene.weathering.model_copy(update={"amount": 0.5})})
    layers = [loader.layer(scene), loader.layer(thin)]
    assert len(surveyed) == 1
    assert torch.equal(*(layer.values for layer in (layers[0], tiny_exemplars.layers[0]) if layer is not None))
    assert not torch.equal(*(layer.values for layer in layers if layer is not None))


def test_layers_of_recipes_keep_the_names_that_they_had_before_models(tiny_dataset: Path) -> None:
    """Else all of them would be painted again."""
    scene = Scene.load(tiny_dataset / "train" / "000000.json")
    as_before = [{"recipe": "road-dirt", "amount": 1.0, "seed": 0, "options": {}}]
    digest = hashlib.sha256(json.dumps(as_before, sort_keys=True).encode()).hexdigest()[:12]
    assert (tiny_dataset / "cache" / "layers" / f"{subject_key(scene)}-{digest}.safetensors").is_file()


def test_a_layer_is_kept_apart_for_other_maps(tiny_dataset: Path, tiny_exemplars: Exemplars) -> None:
    loader, scene = SceneLoader(tiny_dataset, keep=False), tiny_exemplars.scenes[0]
    plain, glossy = loader.layer(scene), loader.layer(scene.model_copy(update={"maps": {"roughness": 0.5}}))
    assert plain is not None
    assert glossy is not None
    assert (plain.maps, glossy.maps) == ((), ("roughness",))
    assert torch.equal(glossy.rgba, plain.values)


def test_the_layer_lies_on_learnable_parts_alone(tiny_exemplars: Exemplars) -> None:
    subject, paint = tiny_exemplars.subjects[0], {"body": (0.9, 0.1, 0.2)}
    layer = Layer(torch.rand(32, 32, 4))
    materials, bare = subject.materials(layer, base_colors=paint), subject.base_colors(paint)
    for part, material in enumerate(materials.parts):
        expected = composite(bare[part], layer) if part in subject.learnable else bare[part]
        assert torch.equal(material.base_color, expected)
    albedo = subject.albedo(layer, base_colors=paint)
    body = subject.learnable[0]
    torch.testing.assert_close(
        albedo[subject.buffer.part == body], composite(bare[body], layer)[subject.buffer.part == body]
    )
    assert torch.equal(subject.learnable_texels, subject.buffer.part == body)
