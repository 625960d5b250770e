"""The folder of the user's that keeps what was baked."""

from __future__ import annotations

import logging
import shutil
from pathlib import Path

import pytest
import torch

from svbrdfgan import __version__
from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.errors import AssetError
from svbrdfgan.scene import loader as loader_module
from svbrdfgan.scene.loader import SceneLoader
from svbrdfgan.scene.subject import Subject
from svbrdfgan.scene.user_cache import VARIABLE, in_user_cache


@pytest.fixture
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(VARIABLE, str(tmp_path / "kept"))
    return tmp_path / "kept"


@pytest.fixture
def fresh(dataset_copy: Path) -> Path:
    shutil.rmtree(dataset_copy / "cache")
    return dataset_copy


def files(folder: Path) -> dict[str, bytes]:
    return {f"{path.parent.name}/{path.name}": path.read_bytes() for path in folder.rglob("*.safetensors")}


def never(*_: object, **__: object) -> None:
    raise AssertionError("baked twice")


def test_nothing_is_baked_for_a_second_data_set(
    fresh: Path, tiny_exemplars: Exemplars, kept: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = tiny_exemplars.scenes[0]
    first = SceneLoader(fresh).with_mesh_maps(scene)
    stored, own = files(kept), files(fresh / "cache")
    assert {name.split("/")[0] for name in stored} == {"subjects", "mesh_maps"}
    assert stored.keys() == own.keys()
    shutil.rmtree(fresh / "cache")
    monkeypatch.setattr(loader_module, "make_subject", never)
    monkeypatch.setattr(loader_module, "bake_mesh_maps", never)
    again = SceneLoader(fresh).with_mesh_maps(scene)
    assert torch.equal(again.generator_input, first.generator_input)
    assert files(fresh / "cache").keys() == own.keys()  # a data set holds all of its own
    assert files(kept) == stored


def test_layers_stay_with_their_data_set(fresh: Path, tiny_exemplars: Exemplars, kept: Path) -> None:
    SceneLoader(fresh).layer(tiny_exemplars.scenes[0])
    assert not [name for name in files(kept) if name.startswith("layers")]
    assert [name for name in files(fresh / "cache") if name.startswith("layers")]


def test_without_a_folder_nothing_is_kept_elsewhere(
    fresh: Path, tiny_exemplars: Exemplars, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, path = tiny_exemplars.scenes[0], fresh / "cache" / "subjects" / "car.safetensors"
    for unset in ("", None):
        monkeypatch.delenv(VARIABLE, raising=False) if unset is None else monkeypatch.setenv(VARIABLE, unset)
        assert in_user_cache(path, scene) is None


def test_versions_windows_and_unknown_contents_are_told_apart(
    fresh: Path, tiny_exemplars: Exemplars, kept: Path
) -> None:
    scene, path = tiny_exemplars.scenes[0], fresh / "cache" / "subjects" / "car.safetensors"
    assert in_user_cache(path, scene) == (
        kept / f"svbrdfgan {__version__}, svbrdfgan {__version__}" / "subjects" / "car.safetensors"
    )
    unhashed = scene.mesh.model_copy(update={"sha256": None})
    for other in ({"window": 16}, {"mesh": unhashed}):
        assert in_user_cache(path, scene.model_copy(update=other)) is None


def test_a_damaged_file_is_named_where_it_lies(fresh: Path, tiny_exemplars: Exemplars, kept: Path) -> None:
    SceneLoader(fresh).subject(tiny_exemplars.scenes[0])
    shutil.rmtree(fresh / "cache")
    (damaged,) = kept.rglob("*.safetensors")
    damaged.write_bytes(b"x" * 100)
    with pytest.raises(AssetError, match="delete it, and it is made again") as caught:
        SceneLoader(fresh).subject(tiny_exemplars.scenes[0])
    assert str(damaged) in str(caught.value)
    assert not files(fresh / "cache")


def test_what_a_mesh_lacks_is_told_of_what_was_kept_too(
    fresh: Path,
    tiny_exemplars: Exemplars,
    kept: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.setattr(Subject, "overlooked", lambda _: ["it lacks something"])
    for told in (1, 2):
        shutil.rmtree(fresh / "cache", ignore_errors=True)
        with caplog.at_level(logging.WARNING):
            SceneLoader(fresh).subject(tiny_exemplars.scenes[0])
        assert caplog.text.count("it lacks something") == told
    SceneLoader(fresh).subject(tiny_exemplars.scenes[0])  # by a later process, of its own cache
    assert caplog.text.count("it lacks something") == 2
    assert len(files(kept)) == 1
