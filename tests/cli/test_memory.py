"""Each command refuses what needs more memory than is allowed, in one sentence, before it begins."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
import yaml
from click.testing import CliRunner

from svbrdfgan.bench.cases import STANDARD, Case
from svbrdfgan.bench.memory import case_bytes
from svbrdfgan.cli import main
from svbrdfgan.data.config import dataset_config
from svbrdfgan.data.memory import exemplar_bytes, require_dataset
from svbrdfgan.geometry.layers import surface_bytes
from svbrdfgan.rendering.picture_memory import picture_bytes
from svbrdfgan.training.config import train_config
from svbrdfgan.training.memory import require_run
from svbrdfgan.training.resolve import resolve_run

SENTENCE = r"needs? about [\d.]+ GiB of memory and [\d.]+ GiB are allowed; .+\."
DATA = {
    "image": [64, 48],
    "texture": 64,
    "environments": {"procedural": {"count": 1}},
    "splits": {"train": {"meshes": {"procedural": {"count": 2}}, "views": 2}},
}


@pytest.fixture(scope="module")
def scene(tiny_dataset: Path) -> Path:
    return tiny_dataset / "train" / "000000.json"


def refused(out: Path, *words: object, gigabytes: float | None = None) -> str:
    """What would fit, as the only line on stderr says. Nothing was written."""
    limit = () if gigabytes is None else ("--memory", gigabytes)
    result = CliRunner().invoke(main, [str(word) for word in (*words, *limit)])
    assert result.exit_code == 1, result.output
    (line,) = [line for line in result.stderr.strip().splitlines() if line.startswith("Error")]
    assert re.search(SENTENCE, line), line
    assert not out.exists() or not [path for path in out.rglob("*") if path.is_file()]
    return line.rpartition("; ")[2]


def grown(scene: Path, folder: Path, **changes: Any) -> Path:
    path = folder / "scene.json"
    path.write_text(json.dumps(json.loads(scene.read_text()) | changes))
    return path


@pytest.mark.parametrize("suffix", [".exr", ".png"])
def test_a_film_that_is_too_large(scene: Path, tiny_dataset: Path, tmp_path: Path, suffix: str) -> None:
    out = tmp_path / f"out{suffix}"
    large = grown(scene, tmp_path, width=40_000, height=30_000)
    fits = refused(out, "render", large, "--assets", tiny_dataset, "-o", out, gigabytes=8)
    width, height = map(int, re.findall(r"\d+", fits))
    limit, texels = 8 << 30, json.loads(scene.read_text())["texture"]
    assert picture_bytes(width, height, texels, suffix) <= limit < picture_bytes(width + 4, height + 3, texels, suffix)
    refused(out, "render", grown(scene, tmp_path, width=10**6, height=10**6), "-o", out)


def test_more_samples_than_scenes_may_have(scene: Path, tmp_path: Path) -> None:
    result = CliRunner().invoke(main, ["render", str(scene), "--spp", str(10**6), "-o", str(tmp_path / "out.exr")])
    assert result.exit_code == 1
    assert "spp" in result.stderr
    assert "65536" in result.stderr


def test_a_surface_of_too_many_texels(van: Path, tmp_path: Path) -> None:
    out = tmp_path / "baked"
    fits = refused(out, "bake", van, "--resolution", 8192, "-o", out, gigabytes=1)
    side = int(fits.split(" x ")[0])
    assert surface_bytes(side) <= 1 << 30 < surface_bytes(side + 16)


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        (["image=[8192,8192]"], r"image=\[\d+,\d+\]"),
        (["texture=4096"], r"texture=\d+"),
        (["splits.train.views=1000000"], r"\d+ exemplars"),
    ],
)
def test_a_data_set(tmp_path: Path, overrides: list[str], said: str) -> None:
    config, out = tmp_path / "data.yaml", tmp_path / "out"
    config.write_text(yaml.safe_dump(DATA))
    assert re.search(said, refused(out, "dataset", config, *overrides, "--workers", 1, "-o", out, gigabytes=1.2))
    refused(out, "dataset", config, *overrides, "--dry-run", "-o", out, gigabytes=1.2)


def test_windows_are_held_instead_of_whole_maps() -> None:
    whole, windows = (
        dataset_config({**DATA, "texture": 2048, "camera": {"close_ups": {"share": 1, **window}}}, "test")
        for window in ({}, {"window": 64})
    )
    assert exemplar_bytes(windows, 3, 1) < exemplar_bytes(whole, 3, 1) / 10
    assert require_dataset(windows, 3) < require_dataset(whole, 3) / 2
    more = exemplar_bytes(whole, 10_000, 1) - exemplar_bytes(whole, 1_000, 1)
    assert exemplar_bytes(windows, 10_000, 1) - exemplar_bytes(windows, 1_000, 1) == more, "pictures alone"
    assert exemplar_bytes(windows, 10_000, 1, scored=True) - exemplar_bytes(windows, 1_000, 1, scored=True) > 2 * more


def test_a_batch(training_data: Callable[..., dict[str, Any]], tmp_path: Path) -> None:
    config, out = tmp_path / "train.yaml", tmp_path / "run"
    config.write_text(json.dumps(training_data()))
    fits = refused(out, "train", config, "batch_size=100000", "-o", out, gigabytes=2)
    assert re.fullmatch(r"batch_size=\d+ would fit\.", fits)
    assert "fewer or smaller pictures" in refused(out, "train", config, "-o", out, gigabytes=0.3)
    assert "fewer or smaller pictures" in refused(out, "probe", config, "-o", out, gigabytes=0.3)


def test_a_layer(van: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    weather = ("weather", van, "--recipe", "dust", "--resolution", 8192)
    assert "--size" in refused(out, *weather, "--size", 8192, "-o", out / "a.glb", gigabytes=1)
    refused(out, *weather, "--embedding-uvs", "-o", out / "a.glb", gigabytes=1)
    texture = ("texture", van, "--count", 3, "--resolution", 4096)
    assert "--size" in refused(out, *texture, "--size", 8192, "-o", out, gigabytes=4.5)
    view = ("view", van, "--recipe", "dust", "--resolution", 4096, "--page", out / "a.html")
    assert re.fullmatch(r"--resolution \d+ would fit\.", refused(out, *view, gigabytes=1))
    refused(out, "parts", van, "--picture", out / "a.png", gigabytes=0.001)


def test_a_benchmark(tmp_path: Path) -> None:
    large = ("--vertices", 10**9), ("--pixels", 100_000), ("--texels", 100_000)
    for option, value in large:
        fits = refused(tmp_path / "out", "bench", option, value, "--backend", "numpy", "-o", tmp_path / "out")
        assert fits.startswith(f"{option} ")


def test_a_benchmark_of_more_takes_more() -> None:
    least = case_bytes(Case(STANDARD, 1000, 64, 4), 64)
    for more in (Case(STANDARD, 2000, 64, 4), Case(STANDARD, 1000, 65, 4), Case(STANDARD, 1000, 64, 5)):
        assert case_bytes(more, 64) > least
    assert case_bytes(Case(STANDARD, 1000, 64, 4, batch=2), 64) > least


@pytest.mark.full
@pytest.mark.parametrize(("side", "suffix"), [(64, ".exr"), (1536, ".exr"), (1536, ".png")])
def test_the_estimate_of_a_picture_is_near_its_peak(
    scene: Path, tiny_dataset: Path, tmp_path: Path, side: int, suffix: str
) -> None:
    path = grown(scene, tmp_path, width=side, height=side, spp=1)
    peak = peak_bytes("render", path, "--assets", tiny_dataset, "--renderer", "mitsuba", "-o", tmp_path / f"a{suffix}")
    assert 0.7 <= picture_bytes(side, side, json.loads(scene.read_text())["texture"], suffix) / peak <= 1.6


@pytest.mark.full
@pytest.mark.parametrize("side", [64, 1024])
def test_the_estimate_of_a_surface_is_near_its_peak(van: Path, tmp_path: Path, side: int) -> None:
    peak = peak_bytes("bake", van, "--resolution", side, "-o", tmp_path / "baked")
    assert 0.7 <= surface_bytes(side) / peak <= 1.6


@pytest.mark.full
@pytest.mark.parametrize("side", [32, 1024])
def test_the_estimate_of_a_data_set_is_near_its_peak(tmp_path: Path, side: int) -> None:
    config = tmp_path / "data.yaml"
    config.write_text(yaml.safe_dump({**DATA, "image": [side, side], "spp": 1}))
    peak = peak_bytes("dataset", config, "--workers", 1, "-o", tmp_path / "out")
    estimate = require_dataset(dataset_config({**DATA, "image": [side, side]}, "test"), 4)
    assert 0.7 <= estimate / peak <= 1.6


@pytest.mark.full
@pytest.mark.parametrize("batch", [1, 8])
def test_the_estimate_of_a_run_is_near_its_peak(tmp_path: Path, batch: int) -> None:
    data, run = tmp_path / "data", tmp_path / "train.yaml"
    (tmp_path / "data.yaml").write_text(yaml.safe_dump({**DATA, "texture": 128, "spp": 1}))
    peak_bytes("dataset", tmp_path / "data.yaml", "--workers", 1, "-o", data)
    config = {"dataset": str(data), "steps": 2, "batch_size": batch, "generator": {"width": 16}, "spp": 1}
    run.write_text(yaml.safe_dump(config))
    estimate = require_run(resolve_run(train_config(config, "test")), ("train",), torch.device("cpu"))
    assert 0.7 <= estimate / peak_bytes("train", run, "-o", tmp_path / "run") <= 1.6


def peak_bytes(*words: object) -> int:
    """What a command's process holds at most; its parent must hold less, which Linux would count."""
    small = (
        "import os, resource, subprocess, sys; subprocess.run(sys.argv[1:], check=True, stdout=2);"
        "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss << 10)"
    )
    command = [sys.executable, "-c", small, sys.executable, "-m", "svbrdfgan", *map(str, words)]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, env=dict(os.environ))
    return int(done.stdout)
