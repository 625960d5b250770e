"""Labels of pixels: beside each picture, as it shows it, and made again where they are missing."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image
from torch import Tensor
from torch.nn.functional import max_pool2d

from svbrdfgan.config.models import validate
from svbrdfgan.data.config import DatasetConfig
from svbrdfgan.data.estimate import estimate
from svbrdfgan.data.exemplar_files import exemplar_paths, load_picture
from svbrdfgan.data.exemplars import load_exemplars
from svbrdfgan.data.generate import generate, render_scene
from svbrdfgan.data.index import Dataset, DatasetIndex
from svbrdfgan.data.labels import make_labels
from svbrdfgan.errors import ConfigError
from svbrdfgan.io.exr import load_exr
from svbrdfgan.plugins.select import resolve_renderer
from svbrdfgan.scene.description import Scene
from svbrdfgan.scene.loader import SceneLoader

ALL = ["weathered", "parts", "depth", "normals"]
CHANNELS = {"weathered", "part.id", "depth.Z", "normal.X", "normal.Y", "normal.Z"}
Data = Callable[..., dict[str, Any]]


@pytest.fixture(scope="module")
def labelled(dataset_data: Data) -> DatasetConfig:
    """One vehicle, partly dirty, in pictures that are large enough to see where."""
    one = {"train": {"meshes": {"procedural": {"count": 1}}, "views": 2}, "validation": {"views": 1}}
    data = dataset_data(image=[64, 48], spp=16, labels=ALL, splits=one, weathering={"recipe": "smooth-dirt"})
    return validate(DatasetConfig, data, "here")


@pytest.fixture(scope="module")
def folder(labelled: DatasetConfig, built_once: Any) -> Path:
    return built_once("labelled", lambda f: generate(labelled, f, base=Path()) and None)


def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted((folder / "train").iterdir())}


def channels(folder: Path, number: int = 0) -> dict[str, Tensor]:
    return load_exr(folder / "train" / f"{number:06d}.labels.exr")


def test_they_lie_beside_each_picture(folder: Path) -> None:
    endings = {name.partition(".")[2] for name in files(folder)}
    assert endings == {"exr", "json", "labels.exr", "parts.png", "weathered.png"}
    assert channels(folder).keys() == CHANNELS
    assert all(plane.shape == (48, 64) for plane in channels(folder).values())


def test_pngs_hold_the_same_numbers(folder: Path) -> None:
    mask, parts = (np.asarray(Image.open(folder / "train" / f"000000.{name}.png")) for name in ("weathered", "parts"))
    assert (mask.dtype, parts.dtype) == (np.uint8, np.uint16)
    np.testing.assert_allclose(mask / 255.0, channels(folder)["weathered"], atol=0.5 / 255 + 1e-6)
    np.testing.assert_array_equal(parts, channels(folder)["part.id"])


def test_the_mask_agrees_with_the_picture(folder: Path) -> None:
    """Where nothing is weathered the picture is that of the clean vehicle, and where much is, it is not."""
    picture, record = exemplar_paths(folder, "train", 0)
    scene = Scene.load(record)
    clean = scene.model_copy(update={"weathering": None})
    twin = render_scene(SceneLoader(folder, keep=False), resolve_renderer(scene.renderer)[0], clean)
    stored, mask = load_picture(picture).float(), channels(folder)["weathered"]
    differs = (stored[..., :3] - twin.image.half().float()).abs().amax(dim=-1)
    around = max_pool2d(mask[None, None], 3, stride=1, padding=1)[0, 0]  # a sample may meet what no point of nine does
    seen = stored[..., 3] > 0
    assert 0 <= mask.min() < 0.1 < 0.9 < mask.max() <= 1
    assert (seen & (around == 0)).sum() > 50
    assert (differs[around == 0] == 0).all()
    assert (mask > 0.7).sum() > 20
    assert (differs[mask > 0.7] > 0.02).float().mean() > 0.95
    assert (mask[~seen] <= 0.2).all()


def test_parts_depth_and_normals_are_of_what_is_seen(folder: Path) -> None:
    dataset, found = Dataset.open(folder), channels(folder)
    ids = {name: number for number, name in dataset.index.parts.items()}
    assert sorted(ids.values()) == list(range(1, len(ids) + 1))
    part, depth = found["part.id"], found["depth.Z"]
    normal = torch.stack([found[f"normal.{axis}"] for axis in "XYZ"], dim=-1)
    coverage = load_picture(exemplar_paths(folder, "train", 0)[0])[..., 3]
    assert (part[coverage == 1] > 0).all()
    assert (part[coverage == 0] == 0).all()
    assert set(part.unique().tolist()) > {0, ids["body"], ids["glass"]}
    carries = torch.isin(part, torch.tensor([float(ids[name]) for name in dataset.index.meshes["train"][0].painted]))
    assert found["weathered"][max_pool2d(carries.float()[None], 3, 1, 1)[0] == 0].max() < 0.2  # slivers between centres
    camera = Scene.load(exemplar_paths(folder, "train", 0)[1]).camera
    assert ((depth > 0) == (part > 0)).all()
    assert 0.5 * camera.distance < depth[part > 0].min() < depth.max() < 1.5 * camera.distance
    torch.testing.assert_close(normal.norm(dim=-1), (part > 0).float(), atol=1e-5, rtol=0)


def test_without_a_layer_nothing_is_weathered(folder: Path) -> None:
    dataset, scene = Dataset.open(folder), Scene.load(exemplar_paths(folder, "train", 0)[1])
    clean = scene.model_copy(update={"weathering": None})
    found = make_labels(SceneLoader(folder), clean, ["weathered", "parts"], dataset.index.parts)
    assert found.keys() == {"weathered", "part.id"}
    assert not found["weathered"].any()
    assert torch.equal(found["part.id"], channels(folder)["part.id"])


def test_only_the_wanted_ones_are_made_and_at_the_same_points(folder: Path) -> None:
    scene = Scene.load(exemplar_paths(folder, "train", 0)[1])
    found = make_labels(SceneLoader(folder), scene, ["depth"], {})
    assert found.keys() == {"depth.Z"}
    assert (found["depth.Z"] - channels(folder)["depth.Z"]).abs().median() < 1e-6
    assert ((found["depth.Z"] > 0) == (channels(folder)["depth.Z"] > 0)).float().mean() > 0.995


def test_bands_of_a_picture_make_the_whole(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("svbrdfgan.data.labels._AT_ONCE", 64 * 9 * 7)  # 48 rows are six bands of seven, and six rows
    dataset, scene = Dataset.open(folder), Scene.load(exemplar_paths(folder, "train", 0)[1])
    found = make_labels(SceneLoader(folder), scene, ALL, dataset.index.parts)
    for name, plane in channels(folder).items():
        assert ((found[name] - plane).abs() > 1e-5).float().mean() < 0.002, name


def test_hidden_halves_have_the_id_of_their_part(folder: Path) -> None:
    from svbrdfgan.data.labels import _ids

    dataset, scene = Dataset.open(folder), Scene.load(exemplar_paths(folder, "train", 0)[1])
    surface = SceneLoader(folder).subject(scene).surface
    assert any(part.hidden for part in surface.parts)
    ids = _ids(surface, dataset.index.parts)
    for part, number in zip(surface.parts, ids, strict=False):
        assert part.mesh_part == dataset.index.parts[int(number)]


def test_an_interrupted_exemplar_is_labelled_again(folder: Path, labelled: DatasetConfig) -> None:
    whole = files(folder)
    for path in (folder / "train").glob("000001*"):
        if path.suffix != ".exr" or "labels" in path.name:
            path.unlink()
    generate(labelled, folder, base=Path())
    assert files(folder) == whole


def test_a_labelled_data_set_is_a_data_set(folder: Path) -> None:
    assert len(load_exemplars(Dataset.open(folder), "train")) == 2


def test_an_estimate_counts_them(labelled: DatasetConfig) -> None:
    plain = estimate(labelled.model_copy(update={"labels": ()}), Path())
    assert estimate(labelled, Path()).disk > plain.disk + plain.exemplars * 2000


def test_unknown_labels_are_told(dataset_data: Data) -> None:
    with pytest.raises(ConfigError, match=r"labels.*'weathered', 'parts', 'depth' or 'normals'"):
        validate(DatasetConfig, dataset_data(labels=["flow"]), "here")


def test_an_index_whose_ids_lack_a_part_is_refused(folder: Path, tmp_path: Path) -> None:
    data = json.loads((folder / "dataset.json").read_text())
    del data["parts"]["1"]
    (tmp_path / "dataset.json").write_text(json.dumps(data))
    with pytest.raises(ConfigError, match="parts gives no id to"):
        DatasetIndex.load(tmp_path)
