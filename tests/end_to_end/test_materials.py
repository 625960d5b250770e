"""All maps of a layer, from configuration to GLB, on vehicles whose other parts shine and whose glass is clear."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from svbrdfgan.data.config import dataset_config
from svbrdfgan.data.exemplars import load_exemplars
from svbrdfgan.data.generate import generate
from svbrdfgan.data.index import Dataset
from svbrdfgan.evaluation.evaluate import evaluate
from svbrdfgan.evaluation.oracle import OracleConfig
from svbrdfgan.inference.apply import paint
from svbrdfgan.io.gltf.surface_files import save_mesh_glb
from svbrdfgan.io.mesh import load_mesh
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.vehicle import build_vehicle
from svbrdfgan.scene.embedded_files import write_embedded
from svbrdfgan.training.config import train_config
from svbrdfgan.training.run import load_model
from svbrdfgan.training.trainer import train
from svbrdfgan.types import FileMap, Mesh, Part

Data = Callable[..., dict[str, Any]]
MAPS = {"roughness": {"uniform": [0.2, 0.5]}, "metallic": 0, "normal": 0}
GLOSSY = {"roughness": FileMap((0.3,)), "metallic": FileMap((0.0,))}
GIVEN = {
    "glass": {**GLOSSY, "alpha": FileMap((0.25,))},
    "rim": {"roughness": FileMap((0.25,)), "metallic": FileMap((1.0,))},
    "trim": GLOSSY,
}
"""What the files say of parts; of others they say nothing."""


@pytest.fixture(scope="module")
def vehicles(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("vehicles")
    for name, seed in (("one", 5), ("two", 6)):
        mesh = build_vehicle(sample_vehicle("van", seed))
        parts = tuple(replace(part, file_maps=GIVEN.get(part.name, {})) for part in mesh.parts)
        save_mesh_glb(folder / f"{name}.glb", Mesh(mesh.positions, mesh.faces, mesh.face_part, parts))
    return folder


@pytest.fixture(scope="module")
def folder(dataset_data: Data, vehicles: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    splits = {
        "train": {"meshes": {"files": ["one.glb"], "procedural": None}, "views": 2},
        "validation": {"meshes": {"files": ["two.glb"], "procedural": None}, "views": 1},
    }
    made = tmp_path_factory.mktemp("materials") / "dataset"
    data = dataset_data(maps=MAPS, spp=4, splits=splits)
    generate(dataset_config(data, "here"), made, base=vehicles)
    return made


@pytest.fixture(scope="module")
def run(training_data: Data, folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("materials") / "run"
    online = {"rendering": "online", "discriminator": {"gbuffer": False}, "spp": 2, "batch_size": 1}
    length = {"steps": 2, "score_every": 2, "save_every": 2}
    train(train_config(training_data(dataset=str(folder), **online, **length), "here"), made)
    return made


def test_a_data_set_keeps_what_its_files_say(folder: Path) -> None:
    exemplars = load_exemplars(Dataset.open(folder), "train")
    subject, scene, layer = exemplars.subject(0), exemplars.scenes[0], exemplars.layers[0]
    assert layer is not None
    assert layer.maps == ("roughness", "metallic", "normal")
    parts = {part.name: part for part in subject.surface.parts}
    assert parts["glass"].alpha == 0.25
    assert parts["body"].opaque
    names = [part.name for part in subject.surface.parts]
    materials = subject.materials(layer, scene.maps, base_colors=scene.materials)
    found = {name: material.maps for name, material in zip(names, materials.parts, strict=True)}
    assert found["body"].keys() == {"base_color", "roughness", "metallic", "normal"}
    assert found["rim"]["metallic"].tolist() == [1.0]
    assert found["tyre"].keys() == {"base_color"}  # the file marks it as Lambertian


def test_the_model_paints_every_map_and_its_glb_says_so(run: Path, vehicles: Path, tmp_path: Path) -> None:
    model = load_model(run)
    assert model.generator.maps == ("roughness", "metallic", "normal")
    subject, layer = paint(load_mesh(vehicles / "two.glb"), model)
    assert layer.maps == ("roughness", "metallic", "normal")
    assert layer["normal"][..., :2].abs().max() < 1
    write_embedded(tmp_path / "car.glb", subject, layer, model.config.maps)
    read: dict[str, Part] = {part.name: part for part in load_mesh(tmp_path / "car.glb").parts}
    assert read["body"].file_maps.keys() == {"roughness", "metallic", "normal"}
    assert read["glass"].file_maps["alpha"].factor == (0.25,)
    assert read["rim"].file_maps == GIVEN["rim"]
    assert read["tyre"].file_maps == {}


@pytest.mark.full
def test_every_map_is_scored(run: Path) -> None:
    evaluated = evaluate(run, split="validation", device="cpu", schedule=OracleConfig(every=2, steps=2))
    scores = evaluated.evaluation.generated.maps
    assert list(scores) == ["base_color", "roughness", "metallic", "normal"]
    for name, score in scores.items():
        flat = name in ("metallic", "normal")  # this thin road dirt is neither of metal nor tilted by 0.1 degrees
        assert (score.recovered is None) == flat
        assert score.error is not None
        assert 0 < evaluated.evaluation.areas[name] <= evaluated.evaluation.seen
