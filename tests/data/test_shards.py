"""Shards, by whomever and in whatever order they are made, are the data set that one machine makes."""

from __future__ import annotations

import json
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from svbrdfgan.cli import main
from svbrdfgan.data.exemplar_files import exemplar_paths
from svbrdfgan.data.index import DatasetIndex
from svbrdfgan.data.shards import MARKS, Shard

Data = Callable[..., dict[str, Any]]
REPOSITORY = Path(__file__).parents[2]


def files(folder: Path) -> dict[str, bytes]:
    """All files but those of the cache, hidden ones, too."""
    found = {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    return {path.as_posix(): content for path, content in found.items() if path.parts[0] != "cache"}


def assert_same(one: Path, other: Path) -> None:
    mine, its = files(one), files(other)
    assert sorted(mine) == sorted(its)
    assert [name for name, content in mine.items() if content != its[name]] == []
    assert not (one / MARKS).exists()


def command(*words: object) -> list[str]:
    """The words of a command that starts no processes, which would take longer than the work."""
    alone = [] if words[0] == "merge" else ["--workers", "1"]
    return ["--quiet", "dataset", *map(str, words), *alone]


def run(*words: object) -> Result:
    return CliRunner().invoke(main, command(*words))


def done(*words: object) -> str:
    result = run(*words)
    assert result.exit_code == 0, result.output
    return result.stdout


def refused(*words: object) -> str:
    result = run(*words)
    assert result.exit_code == 1, result.output
    (line,) = result.stderr.splitlines()
    return line


@pytest.fixture
def config(tmp_path: Path, dataset_data: Data) -> Path:
    path = tmp_path / "dataset.yaml"
    path.write_text(json.dumps(dataset_data()))
    return path


@pytest.fixture
def halves(tmp_path: Path, tiny_dataset: Path) -> tuple[Path, Path]:
    """Two folders with a shard of two each, cut out of the whole data set."""
    index, folders = DatasetIndex.load(tiny_dataset), (tmp_path / "one", tmp_path / "two")
    for shard, folder in zip(Shard.all(2), folders, strict=True):
        shutil.copytree(tiny_dataset, folder, ignore=shutil.ignore_patterns("cache"))
        cut(folder, index, [other for other in Shard.all(2) if other != shard])
        mark(folder, shard)
    return folders


def mark(folder: Path, shard: Shard) -> None:
    (folder / MARKS).mkdir(exist_ok=True)
    (folder / MARKS / f"{shard.number}-of-{shard.count}").touch()


def cut(folder: Path, index: DatasetIndex, shards: Sequence[Shard]) -> None:
    for shard in shards:
        for split, number in shard.of(index.exemplars()):
            for path in exemplar_paths(folder, split, number):
                path.unlink()


@pytest.mark.parametrize(("count", "items"), [(1, 5), (3, 8), (4, 4), (7, 5), (5, 0), (1000, 999)])
def test_shards_are_a_partition_into_equal_shares(count: int, items: int) -> None:
    shares = [shard.of(range(items)) for shard in Shard.all(count)]
    assert [item for share in shares for item in share] == list(range(items))
    assert max(map(len, shares)) - min(map(len, shares)) <= 1
    assert all(item in Shard.holding(item, items, count).of(range(items)) for item in range(items))


@pytest.mark.parametrize("text", ["0/3", "4/3", "x/y", "3", "1/0", "-1/3", "1/3/5", "", "1.0/3", "²/3"])
def test_what_names_no_shard_is_told(text: str, config: Path, tmp_path: Path) -> None:
    told = refused(config, "-o", tmp_path / "out", "--shard", text)
    assert told == f"Error: --shard {text}: wanted I/N, with I from 1 to N, such as 2/4."
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("other", ["--dry-run", "--preview"])
def test_what_makes_no_data_set_has_no_shards(other: str, config: Path, tmp_path: Path) -> None:
    result = run(config, "-o", tmp_path / "out", "--shard", "1/2", other)
    assert result.exit_code == 2
    assert f"--shard and {other} exclude each other." in result.stderr


@pytest.mark.parametrize("order", [[1], [2, 3, 1]])
def test_shards_in_one_folder(order: list[int], config: Path, tmp_path: Path, tiny_dataset: Path) -> None:
    folder = tmp_path / "out"
    for number in order:
        share = Shard(number, len(order)).of(range(8))
        said = done(config, "-o", folder, "--shard", f"{number}/{len(order)}")
        assert said == f"shard {number}/{len(order)}: {len(share)} of the 8 exemplars\n"
    done("merge", folder)
    assert_same(folder, tiny_dataset)


@pytest.mark.full
def test_shards_in_folders_of_their_own(config: Path, tmp_path: Path, tiny_dataset: Path) -> None:
    folders = [tmp_path / f"shard-{number}" for number in (3, 1, 2)]
    for folder in folders:
        done(config, "-o", folder, "--shard", f"{folder.name[-1]}/3")
    before = [files(folder) for folder in folders]
    assert done("merge", *folders, "-o", tmp_path / "out") == (
        "train: 6 exemplars of 2 meshes\nvalidation: 2 exemplars of 1 meshes\n"
    )
    assert_same(tmp_path / "out", tiny_dataset)
    assert [files(folder) for folder in folders] == before
    assert done(config, "-o", tmp_path / "out").startswith("train: 6 exemplars")
    assert_same(tmp_path / "out", tiny_dataset)


@pytest.mark.full
def test_labels_are_merged(tmp_path: Path, dataset_data: Data) -> None:
    splits = {"train": {"meshes": {"procedural": {"count": 1}}, "views": 2}, "validation": {"views": 1}}
    data = dataset_data(image=[8, 8], spp=1, labels=["weathered", "parts", "depth"], splits=splits)
    config = tmp_path / "dataset.yaml"
    config.write_text(json.dumps(data))
    done(config, "-o", tmp_path / "whole")
    folders = [tmp_path / str(number) for number in (1, 2)]
    for folder in folders:
        done(config, "-o", folder, "--shard", f"{folder.name}/2")
    done("merge", *folders, "-o", tmp_path / "out")
    assert_same(tmp_path / "out", tmp_path / "whole")
    assert (tmp_path / "out" / "train" / "000001.parts.png").is_file()


def test_more_shards_than_exemplars(config: Path, dataset_copy: Path, tiny_dataset: Path) -> None:
    said = [done(config, "-o", dataset_copy, "--shard", f"{number}/20") for number in (1, 20)]
    assert said == ["shard 1/20: none of the 8 exemplars\n", "shard 20/20: 1 of the 8 exemplars\n"]
    done("merge", dataset_copy)
    assert_same(dataset_copy, tiny_dataset)


def test_folders_are_joined(halves: tuple[Path, Path], tmp_path: Path, tiny_dataset: Path) -> None:
    done("merge", *halves, halves[0], "-o", tmp_path / "new" / "out")
    assert_same(tmp_path / "new" / "out", tiny_dataset)


def test_one_machine_completes_what_shards_began(config: Path, halves: tuple[Path, Path], tiny_dataset: Path) -> None:
    done(config, "-o", halves[0])
    assert_same(halves[0], tiny_dataset)


def test_leftovers_of_other_machines_are_removed(halves: tuple[Path, Path], config: Path, tiny_dataset: Path) -> None:
    (halves[0] / "train" / ".000001.1-000000000000.exr").touch()
    done(config, "-o", halves[0], "--shard", "2/2")
    done("merge", halves[0])
    assert_same(halves[0], tiny_dataset)


def test_missing_shards_are_named(halves: tuple[Path, Path], dataset_copy: Path, tmp_path: Path) -> None:
    one = halves[0]
    assert refused("merge", one) == (
        f"Error: {one} lacks 4 of 8 exemplars, of the shards 2/2: make them, such as by `svbrdfgan dataset CONFIG "
        f"-o {one} --shard 2/2`, and merge again."
    )
    assert "lacks 4 of 8 exemplars, of the shards 2/2" in refused("merge", one, "-o", tmp_path / "out")
    assert not (tmp_path / "out").exists()
    index = DatasetIndex.load(dataset_copy)
    cut(dataset_copy, index, [Shard(2, 8), Shard(7, 8)])
    assert "lacks 2 of 8 exemplars: `svbrdfgan dataset CONFIG -o" in refused("merge", dataset_copy)
    mark(dataset_copy, Shard(1, 8))
    assert "of the shards 2/8, 7/8:" in refused("merge", dataset_copy)
    assert (dataset_copy / MARKS / "1-of-8").is_file()


def test_what_cannot_be_merged_is_told(halves: tuple[Path, Path], tmp_path: Path, dataset_data: Data) -> None:
    one, two = halves
    assert refused("merge", *halves) == "Error: several folders are joined into another one: name it by -o."
    assert refused("merge", *halves, "-o", two) == (
        f"Error: {two} already exists; choose another folder to join the shards in."
    )
    assert "is not a data set" in refused("merge", tmp_path)
    index = two / "dataset.json"
    index.write_text(index.read_text().replace('"seed": 3', '"seed": 4'))
    told = refused("merge", *halves, "-o", tmp_path / "out")
    assert told == f"Error: {one} and {two} are of different configurations (seed 3, not 4); merge others."
    index.write_text((one / "dataset.json").read_text().replace('"normalisation": ', '"normalisation": 1'))
    assert "their meshes, environments or models differ" in refused("merge", *halves, "-o", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_damage_is_found(dataset_copy: Path, tiny_dataset: Path) -> None:
    picture, record = exemplar_paths(dataset_copy, "train", 3)
    picture.unlink()
    assert refused("merge", dataset_copy).startswith(f"Error: {picture} is missing: delete {record}")
    shutil.copy(exemplar_paths(tiny_dataset, "train", 3)[0], picture)
    record.write_bytes(exemplar_paths(tiny_dataset, "train", 2)[1].read_bytes())
    assert refused("merge", dataset_copy).startswith(f"Error: {record} is not the scene of that number")
    record.write_bytes(exemplar_paths(tiny_dataset, "train", 3)[1].read_bytes())
    (mesh, *_) = (dataset_copy / "assets" / "meshes").iterdir()
    mesh.write_bytes(b"")
    assert f"{mesh} is not the file that the scene was made with" in refused("merge", dataset_copy)


def test_exemplars_of_several_renderers_are_told(dataset_copy: Path, caplog: pytest.LogCaptureFixture) -> None:
    record = exemplar_paths(dataset_copy, "train", 3)[1]
    scene = json.loads(record.read_text())
    scene["renderer"] = {"name": "mitsuba", "options": {}}
    record.write_text(json.dumps(scene))
    done("merge", dataset_copy)
    assert "the exemplars are by several renderers (mitsuba, " in caplog.text


def test_shards_of_something_else_are_told(
    config: Path, halves: tuple[Path, Path], dataset_copy: Path, tmp_path: Path
) -> None:
    one = halves[0]
    assert refused(config, "-o", one, "--shard", "2/3") == (
        f"Error: {one} holds shards of 2, and --shard is 2/3: wanted I/2, or another folder."
    )
    told = refused(config, "seed=4", "-o", one, "--shard", "2/2")
    assert told.startswith(f"Error: {one} holds a data set of another configuration (seed 3, not 4);")
    for record in one.glob("*/0*.json"):
        record.unlink()
    assert "of another configuration" in refused(config, "seed=4", "-o", one, "--shard", "2/2")
    assert "of another configuration" in refused(config, "seed=4", "-o", one), "others may be about to write"
    assert "of another configuration" in refused(config, "seed=4", "-o", dataset_copy, "--shard", "1/2")
    assert not (dataset_copy / MARKS).exists()
    assert "no file matches" in refused(config, "environments.files=[a*]", "-o", tmp_path / "new", "--shard", "1/2")
    assert not (tmp_path / "new").exists()


class Process(subprocess.Popen[str]):
    """The program, at work."""

    def __init__(self, *words: object, doing: str = "") -> None:
        code = f"{doing}\nimport sys\nfrom svbrdfgan.cli import main\nmain(sys.argv[1:])"
        program = [sys.executable, "-c", code, *command(*words)]
        super().__init__(program, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)

    def stop_when(self, happened: Callable[[], bool]) -> None:
        """Stops it there, so that it stays at work, however long others take; killing still ends it."""
        while not happened():
            assert self.poll() is None, self.communicate()
            time.sleep(0.005)
        self.send_signal(signal.SIGSTOP)


@pytest.fixture
def many(tmp_path: Path, dataset_data: Data) -> Path:
    """So many exemplars that a process is stopped before it has made all."""
    path = tmp_path / "many.yaml"
    data = dataset_data(image=[8, 8], spp=1, splits={"train": {"views": 200}, "validation": {"views": 2}})
    path.write_text(json.dumps(data))
    return path


@pytest.mark.full
def test_shards_and_who_wants_the_whole_exclude_each_other(many: Path, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    with Process(many, "-o", folder, "--shard", "1/2") as shard:
        shard.stop_when(lambda: any(folder.glob("train/0*.json")))
        for words in ((many, "-o", folder), ("merge", folder)):
            told = refused(*words)
            assert told == f"Error: {folder} is being written by another process; wait until it has ended."
        told = refused(many, "-o", folder, "--shard", "1/2")
        assert told == f"Error: the shard 1/2 of {folder} is being made by another process; wait until it has ended."
        shard.kill()
    made = len(list(folder.glob("train/0*.json")))
    with Process(many, "-o", folder) as whole:
        whole.stop_when(lambda: len(list(folder.glob("train/0*.json"))) > made)
        told = refused(many, "-o", folder, "--shard", "2/2")
        assert told == f"Error: {folder} is being written by another process; wait until it has ended."
        whole.kill()


DIES = """
import os, signal
from pathlib import Path
import {module} as module
from {module} import {name} as before
def dies(*words, **named):
    before(*words, **named)
    if any(Path(word).name == "000002.exr" for word in words if isinstance(word, (Path, str))):
        os.kill(os.getpid(), signal.SIGKILL)
module.{name} = dies
"""
"""Lets a process be killed after it has called a function with the third picture of a split."""


@pytest.mark.full
def test_two_shards_at_once_one_of_them_killed(config: Path, tmp_path: Path, tiny_dataset: Path) -> None:
    folder, dies = tmp_path / "out", DIES.format(module="svbrdfgan.data.generate", name="save_exemplar")
    with (
        Process(config, "-o", folder, "--shard", "1/2", doing=dies) as killed,
        Process(config, "-o", folder, "--shard", "2/2") as other,
    ):
        assert other.communicate() == ("shard 2/2: 4 of the 8 exemplars\n", None)
        assert killed.wait() == -signal.SIGKILL
    before = {path: path.stat().st_mtime_ns for path in folder.glob("*/0*.json")}
    assert len(before) == 6
    assert "lacks 2 of 8 exemplars, of the shards 1/2" in refused("merge", folder)
    done(config, "-o", folder, "--shard", "1/2")
    assert {path: path.stat().st_mtime_ns for path in before} == before, "what is whole is not made again"
    done("merge", folder)
    assert_same(folder, tiny_dataset)


@pytest.mark.full
def test_a_merge_that_is_killed_changes_nothing(halves: tuple[Path, Path], tmp_path: Path, tiny_dataset: Path) -> None:
    out, dies = tmp_path / "joined" / "out", DIES.format(module="shutil", name="copyfile")
    before = [files(half) for half in halves]
    with Process("merge", *halves, "-o", out, doing=dies) as merging:
        assert merging.wait() == -signal.SIGKILL
    (left,) = out.parent.iterdir()
    assert left.name.startswith(".out.")
    done("merge", *halves, "-o", out)
    assert_same(out, tiny_dataset)
    assert [files(half) for half in halves] == before


@pytest.mark.full
def test_shards_by_xargs(config: Path, tmp_path: Path, tiny_dataset: Path) -> None:
    """The line of docs/many-machines.md for one machine, with its numbers and paths put in."""
    page = (REPOSITORY / "docs" / "many-machines.md").read_text(encoding="utf-8")
    (line,) = re.findall(r"^seq .*\| xargs .*$", page, re.MULTILINE)
    for there, here in (("8", "3"), ("dataset.yaml", str(config)), ("data/cars", str(tmp_path / "out"))):
        assert there in line
        line = line.replace(there, here)
    line = line.replace("svbrdfgan ", f"{sys.executable} -m svbrdfgan --quiet ")
    ended = subprocess.run(["sh", "-ec", line], capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr
    assert sorted(ended.stdout.splitlines()) == [
        f"shard {shard}: {len(shard.of(range(8)))} of the 8 exemplars" for shard in Shard.all(3)
    ]
    done("merge", tmp_path / "out")
    assert_same(tmp_path / "out", tiny_dataset)
