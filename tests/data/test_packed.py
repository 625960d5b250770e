"""Packed exemplars are those of the loose files, and `tar` unpacks them."""

from __future__ import annotations

import io
import json
import shutil
import tarfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from svbrdfgan.data import exemplar_files
from svbrdfgan.data.exemplar_files import SplitFiles, exemplar_paths, load_picture
from svbrdfgan.data.exemplars import load_exemplars
from svbrdfgan.data.index import Dataset
from svbrdfgan.errors import AssetError
from svbrdfgan.scene.description import Scene
from tests.data.test_shards import assert_same, done, files, halves, refused  # noqa: F401  (halves is a fixture)

Data = Callable[..., dict[str, Any]]


@pytest.fixture
def threes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Packs have three exemplars each."""
    monkeypatch.setattr(exemplar_files, "PACK", 3)


@pytest.fixture
def packed(dataset_copy: Path, threes: None) -> Path:
    done("merge", dataset_copy, "--pack")
    return dataset_copy


def names(path: Path) -> list[str]:
    with tarfile.open(path) as tar:
        return tar.getnames()


def unpack(folder: Path) -> None:
    for path in folder.glob("*.tar"):
        shutil.unpack_archive(path, folder / path.name.partition("-")[0], filter="data")
        path.unlink()


def test_a_packed_data_set_is_read_like_a_loose_one(packed: Path, tiny_dataset: Path) -> None:
    assert sorted(path.name for path in packed.iterdir() if path.name != "cache") == [
        *("assets", "dataset.json", "train-0000.tar", "train-0001.tar", "validation-0000.tar")
    ]
    assert names(packed / "train-0001.tar") == [f"00000{n}.{kind}" for n in (3, 4, 5) for kind in ("exr", "json")]
    for split in ("train", "validation"):
        mine, its = (load_exemplars(Dataset.open(folder), split) for folder in (packed, tiny_dataset))  # type: ignore[arg-type]
        assert mine.scenes == its.scenes
        assert torch.equal(mine.images, its.images)
        assert torch.equal(mine.coverage, its.coverage)
    unpack(packed)
    assert_same(packed, tiny_dataset)


def test_equal_data_sets_are_packed_to_equal_bytes(
    packed: Path,
    halves: tuple[Path, Path],  # noqa: F811
    tmp_path: Path,
) -> None:
    done("merge", *halves, "-o", tmp_path / "out", "--pack")
    assert_same(tmp_path / "out", packed)
    done("merge", packed, "-o", tmp_path / "again", "--pack")
    assert_same(tmp_path / "again", packed)
    with tarfile.open(packed / "train-0000.tar") as tar:
        assert {(member.mtime, member.uid, member.uname, member.mode) for member in tar} == {(0, 0, "", 0o644)}


def test_packed_shards_are_merged_into_loose_files(packed: Path, tmp_path: Path, tiny_dataset: Path) -> None:
    done("merge", packed, "-o", tmp_path / "out")
    assert_same(tmp_path / "out", tiny_dataset)


def test_the_data_set_makes_nothing_of_a_packed_one_again(packed: Path, tmp_path: Path, dataset_data: Data) -> None:
    before, config = files(packed), tmp_path / "dataset.yaml"
    config.write_text(json.dumps(dataset_data()))
    done(config, "-o", packed)
    assert files(packed) == before
    assert "of another configuration (seed 3, not 4)" in refused(config, "seed=4", "-o", packed)
    (packed / "train-0001.tar").unlink()
    done(config, "-o", packed)
    assert sorted(SplitFiles(packed, "train").numbers) == list(range(6))
    done("merge", packed, "--pack")
    assert files(packed) == before


def test_packing_goes_on_where_it_was_killed(packed: Path, tiny_dataset: Path) -> None:
    wanted = files(packed)
    (packed / "train-0001.tar").unlink()
    (packed / ".train-0001.1-000000000000.tar").write_bytes(b"half")
    shutil.copytree(tiny_dataset / "train", packed / "train")
    exemplar_paths(packed, "train", 0)[1].unlink()  # as when loose files were being removed
    done("merge", packed, "--pack")
    assert files(packed) == wanted


def test_other_files_of_the_folder_stay(dataset_copy: Path) -> None:
    (dataset_copy / "train" / "notes.txt").write_text("mine")
    (dataset_copy / "train" / "000000.png").write_text("mine")
    done("merge", dataset_copy, "--pack")
    assert sorted(path.name for path in (dataset_copy / "train").iterdir()) == ["000000.png", "notes.txt"]


def test_labels_are_packed(tmp_path: Path, dataset_data: Data) -> None:
    splits = {"train": {"meshes": {"procedural": {"count": 1}}, "views": 2}}
    config, out = tmp_path / "dataset.yaml", tmp_path / "out"
    config.write_text(json.dumps(dataset_data(image=[8, 8], spp=1, labels=["weathered", "parts"], splits=splits)))
    done(config, "-o", out)
    before = files(out)
    done("merge", out, "--pack")
    kinds = ("exr", "labels.exr", "weathered.png", "parts.png", "json")
    assert names(out / "train-0000.tar") == [f"00000{n}.{kind}" for n in (0, 1) for kind in kinds]
    unpack(out)
    assert files(out) == before


def test_a_damaged_pack_is_named(packed: Path) -> None:
    dataset, path = Dataset.open(packed), packed / "train-0001.tar"
    whole = path.read_bytes()
    path.write_bytes(whole[:700])
    with pytest.raises(AssetError, match=rf"{path} cannot be read as a tar file \(ReadError: unexpected end of data\)"):
        load_exemplars(dataset, "train")
    path.write_bytes(b"")
    with pytest.raises(AssetError, match=f"{path} is empty"):
        load_exemplars(dataset, "train")
    path.unlink()
    with pytest.raises(AssetError, match="3 of 6 train exemplars are missing"):
        load_exemplars(dataset, "train")


def test_damage_within_a_pack_is_named(packed: Path) -> None:
    path = packed / "train-0001.tar"
    whole = path.read_bytes()
    path.write_bytes(whole.replace(b"v/1\x01", b"nope"))
    with pytest.raises(AssetError, match=f"{path}/000003.exr cannot be read as a picture"):
        load_exemplars(Dataset.open(packed), "train")
    path.write_bytes(whole.replace(b'"mesh"', b'"mash"'))
    assert refused("merge", packed).startswith(f"Error: {path}/000003.json: ")


def test_members_of_other_kinds_are_passed_over(packed: Path, tmp_path: Path) -> None:
    """A stranger's tar file names no place outside."""
    path = packed / "train-0001.tar"
    with tarfile.open(path, "a") as tar:
        for name, kind in (
            ("../out.exr", tarfile.REGTYPE),
            ("000007.json", tarfile.SYMTYPE),
            ("train", tarfile.DIRTYPE),
        ):
            member = tarfile.TarInfo(name)
            member.type, member.linkname = kind, str(tmp_path)
            tar.addfile(member, io.BytesIO())
    assert sorted(SplitFiles(packed, "train").numbers) == list(range(6))
    with SplitFiles(packed, "train") as stored, stored.exemplar(5) as (picture, record):
        assert [path.name for path in sorted(picture.parent.iterdir())] == ["000005.exr", "000005.json"]
        assert load_picture(picture).shape[-1] == 4
        assert Scene.load(record).width == load_picture(picture).shape[1]
    assert not picture.parent.exists()


def test_a_pack_of_too_many_files_is_refused(packed: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exemplar_files, "PACK", 1)
    with pytest.raises(AssetError, match=r"train-0000\.tar has more than 5 files; it is no pack of exemplars"):
        SplitFiles(packed, "train")
