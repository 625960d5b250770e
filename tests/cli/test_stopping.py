"""Ctrl-C and SIGTERM: commands end with exit code 130 or 143, and a sentence says what is kept and how to go on."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
import trimesh
from click.testing import CliRunner

from svbrdfgan.cli import main
from svbrdfgan.utils.stopping import exit_code

DATASET: dict[str, Any] = {"splits": {"train": {"meshes": {"procedural": {"count": 2}}, "views": 40}}}
MANY: dict[str, Any] = {
    "splits": {"train": {"meshes": {"procedural": {"count": 2}}, "views": 160}},
    "image": [16, 16],
    "texture": 16,
    "spp": 1,
}
"""So many exemplars that a busy machine does not end them before a test tells it to stop."""

STOPPED = [
    (
        "dataset {dataset} -o {out}",
        "svbrdfgan.data.generate.generate",
        "{out} keeps the exemplars that are complete, and the same command makes the others.",
    ),
    (
        "dataset merge {out} {run} -o {out}",
        "svbrdfgan.data.merge.merge_shards",
        "the shards are as they were, and the same command merges them.",
    ),
    (
        "dataset import {manifest} -o {out}",
        "svbrdfgan.data.photos.manifest.read_manifest",
        "nothing was written, and the same command imports all pictures again.",
    ),
    (
        "dataset photograph {dataset} -o {out}",
        "svbrdfgan.data.staged_photos.config.staged_photos_config",
        "{out} keeps the photographs that are complete, and the same command takes the others.",
    ),
    (
        "train {train} -o {out}",
        "svbrdfgan.training.trainer.train",
        "{out} has no checkpoint yet, and the same command starts anew.",
    ),
    (
        "train {train} -o {run}",
        "svbrdfgan.training.trainer.train",
        "{run} keeps the checkpoint of step 200, and the same command with --resume continues.",
    ),
    (
        "learn {manifest} {train} -o {out}",
        "svbrdfgan.data.photos.manifest.read_manifest",
        "{out} keeps complete imports and the last checkpoint, and the same command continues.",
    ),
    (
        "experiment training -o {out}",
        "svbrdfgan.experiments.runner.run_experiments",
        "{out} keeps what is complete and the checkpoints of runs, and the same command continues.",
    ),
    (
        "demo --out {out}",
        "svbrdfgan.experiments.demo.open_demo",
        "{out} keeps what is complete, and the same command continues.",
    ),
    ("weather {mesh} -o {out}/a.glb", "svbrdfgan.inference.workpiece.load_asset", "nothing was written."),
    ("parts {mesh}", "svbrdfgan.asset.asset.load_asset", "nothing was written."),
]


def interrupted(*_: object, **__: object) -> Any:
    raise KeyboardInterrupt


@pytest.mark.parametrize(("words", "slow", "sentence"), STOPPED, ids=lambda value: value.split(" -o")[0])
def test_a_sentence_says_what_is_kept(
    words: str, slow: str, sentence: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    paths = {name: tmp_path / f"{name}.yaml" for name in ("dataset", "train", "manifest")}
    paths["dataset"].write_text(json.dumps(DATASET))
    paths["train"].write_text("dataset: data\n")
    paths["manifest"].write_text("a: 1\n")
    paths |= {"out": tmp_path / "out", "run": tmp_path / "run", "mesh": tmp_path / "box.obj"}
    for step in (100, 200):
        (paths["run"] / "checkpoints" / f"step_{step:08d}").mkdir(parents=True)
    trimesh.creation.box((1, 0.5, 2)).export(paths["mesh"])
    monkeypatch.setattr(slow, interrupted)
    result = CliRunner().invoke(main, ["--quiet", *words.format(**paths).split()])
    assert (result.exit_code, result.stdout) == (130, "")
    assert result.stderr == f"stopped; {sentence.format(**paths)}\n"


@pytest.mark.parametrize(
    ("given", "code"), [((), 130), (("",), 130), ((signal.SIGINT,), 130), ((signal.SIGTERM,), 143)]
)
def test_the_exit_code_says_what_stopped_it(given: tuple[Any, ...], code: int) -> None:
    """Libraries raise it with words of their own."""
    assert exit_code(KeyboardInterrupt(*given)) == code


def test_weather_says_which_meshes_are_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def write(scenes: object, mesh: Path, weathering: object, path: Path, *_: object) -> list[Path]:
        return interrupted() if mesh.stem == "b" else [path]

    monkeypatch.setattr("svbrdfgan.cli.scenes.Scenes.open", lambda scenes, mesh, settles_on: mesh)
    monkeypatch.setattr("svbrdfgan.cli.scenes.Scenes.write", write)
    out = tmp_path / "out"
    result = CliRunner().invoke(main, ["--quiet", "weather", "a.glb", "b.glb", "c.glb", "-o", str(out)])
    assert (result.exit_code, result.stdout) == (130, "")
    assert result.stderr == f"stopped; written are {out / 'a.glb'}; to go on, name the other meshes or seeds.\n"


@pytest.mark.full
@pytest.mark.skipif(os.name != "posix", reason="signals are those of POSIX")
@pytest.mark.parametrize(
    ("tell", "number"),
    [(os.killpg, signal.SIGINT), (os.kill, signal.SIGINT), (os.killpg, signal.SIGTERM), (os.kill, signal.SIGTERM)],
)
def test_a_data_set_that_is_stopped_continues(tell: Any, number: int, tmp_path: Path) -> None:
    """Also where the worker processes are told, as by Ctrl-C in a terminal."""
    (tmp_path / "dataset.yaml").write_text(json.dumps(MANY))
    out = tmp_path / "out"
    words = [sys.executable, "-m", "svbrdfgan", "dataset", str(tmp_path / "dataset.yaml"), "-o", str(out)]
    process = subprocess.Popen(
        [*words, "--workers", "2"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    while len(list(out.glob("train/*.json"))) < 2:
        assert process.poll() is None
        time.sleep(0.01)
    tell(process.pid, number)
    printed, said = process.communicate(timeout=60)
    made = list(out.glob("train/*.json"))
    assert (process.returncode, printed) == (128 + number, "")
    assert said.splitlines()[-1] == (
        f"stopped; {out} keeps the exemplars that are complete, and the same command makes the others."
    )
    assert "Traceback" not in said
    assert 2 <= len(made) < 320
    before = {path: path.stat().st_mtime_ns for path in made}
    assert subprocess.run(words, capture_output=True).returncode == 0
    assert len(list(out.glob("train/*.json"))) == 320
    assert {path: path.stat().st_mtime_ns for path in made} == before
