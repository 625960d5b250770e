"""`benchmarks/photographs.py`: its rows are declared rightly, and it goes from pictures to a table."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import yaml
from click.testing import CliRunner

from svbrdfgan.cli import main
from svbrdfgan.config.yaml_files import apply_overrides, load_yaml
from svbrdfgan.data.photos.manifest import read_manifest
from svbrdfgan.data.staged_photos.config import staged_photos_config
from svbrdfgan.training.config import train_config

BENCHMARKS = Path(__file__).parents[3] / "benchmarks"
PICTURE = {"file": "a.jpg", "mesh": "a.glb", "camera": {"position": [0, 1, 4], "look_at": [0, 0, 0]}}
QUICK: dict[str, Any] = {"name": "mitsuba", "device": "cpu"}
DATA: dict[str, Any] = {
    "texture": 32,
    "renderer": QUICK,
    "embedding": {"name": "hemispherical", "resolution": 32},
    "environment_rows": 16,
    "spp": 4,
    "maps": {"roughness": 0.3},
    "weathering": {"recipe": "smooth-dirt", "amount": {"uniform": [0.3, 1]}, "seed": {"uniform": [0, 99]}},
    "environments": {"procedural": {"count": 2}},
    "splits": {
        "train": {"meshes": {"procedural": {"count": 2, "seed": 1}}, "views": 1},
        "test": {"meshes": {"procedural": {"count": 1, "seed": 2}}, "views": 1},
    },
    "photography": {"pool": {"procedural": {"count": 1, "seed": 9}}},
}


@pytest.fixture
def benchmark() -> ModuleType:
    spec = importlib.util.spec_from_file_location("photographs", BENCHMARKS / "photographs.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["photographs"] = module  # where dataclasses look annotations up
    spec.loader.exec_module(module)
    return module


def test_its_rows_are_valid(benchmark: ModuleType) -> None:
    photos = load_yaml(BENCHMARKS / "photographs.yaml")
    shared = set()
    for row in benchmark.ROWS.values():
        settings = {"dataset": "data", **yaml.safe_load(benchmark.TRAIN), "steps": row.steps}
        assert train_config(apply_overrides(settings, [f"loss.r1={row.r1}"]), "row").score_every > row.steps
        if row.photography is not None:
            staged_photos_config({**photos, "photography": {**photos["photography"], **row.photography}}, "row")
            shared.add(row.pictures)
        changes = benchmark.words(benchmark.importing(row))
        assert read_manifest(apply_overrides({"pictures": [PICTURE]}, changes), "row").image == benchmark.IMAGE
    assert shared == {"plain-6", "before-6", "flash-Raw-6", "plain-58"}
    splits = [set(split["meshes"]["files"]) for split in photos["splits"].values()]
    assert [len(files) for files in splits] == [35, 4, 12]
    assert len(set.union(*splits)) == 51


def test_the_table_compares_with_what_is_rendered(benchmark: ModuleType) -> None:
    lines = list(benchmark.table({"matched": [0.5, 0.7], "turns": [0.3, 0.3], "turns-2030": [0.5, 0.5]}))
    assert lines[2:4] == ["| matched | 0.60 | 0.50, 0.70 | 1.00 |", "| turns | 0.30 | 0.30, 0.30 | 0.50 |"]
    assert lines[4] == "| turns-2030 | 0.50 | 0.50, 0.50 |  |"
    assert list(benchmark.table({"turns": [0.3]}))[2:] == ["| turns | 0.30 | 0.30 |  |"]


def in_this_process(otherwise: Callable[..., Any]) -> Callable[..., Any]:
    """Runs the benchmark's commands without starting a Python for each."""

    def run(command: list[str], **options: Any) -> Any:
        if command[0] != sys.executable:
            return otherwise(command, **options)
        result = CliRunner().invoke(main, command[3:])
        options["stdout"].write(result.output)
        return subprocess.CompletedProcess(command, result.exit_code)

    return run


@pytest.mark.full
def test_it_makes_a_table_and_goes_on(
    benchmark: ModuleType, blender: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(benchmark, "IMAGE", (24, 24))
    generator = {"width": 4, "blocks": 1, "random_fields": 2, "conditions": False}
    tiny: dict[str, Any] = {"batch_size": 2, "spp": 4, "renderer": QUICK, "device": "cpu", "generator": generator}
    tiny["discriminator"] = {"width": 4, "layers": 1}
    monkeypatch.setattr(benchmark, "TRAIN", json.dumps(yaml.safe_load(benchmark.TRAIN) | tiny))
    rows = {
        "matched": benchmark.Row(None, 2, 0.03, views=1),
        "before": benchmark.Row({"pairs": "before"}, 2, 0.1, {"bootstrap": 1}, views=1),
        "turns": benchmark.Row({"noise": 0}, 2, 0.1, {"bootstrap": 1, "light": "mean"}, turns=2, views=1),
    }
    monkeypatch.setattr(benchmark, "ROWS", rows)
    (tmp_path / "photos.yaml").write_text(json.dumps({**DATA, "image": [32, 32]}))
    words = [str(tmp_path / "photos.yaml"), "-o", str(tmp_path / "out"), "--seeds", "0", "--blender", blender]
    words += ["--rows", "matched,before,turns"]
    really = benchmark.subprocess.run
    monkeypatch.setattr(benchmark.subprocess, "run", in_this_process(really))
    result = CliRunner().invoke(benchmark.main, words)
    logs = "".join(path.read_text() for path in (tmp_path / "out" / "logs").iterdir())
    assert result.exit_code == 0, result.output + logs
    assert len((tmp_path / "out" / "table.md").read_text().splitlines()) == 5
    monkeypatch.setattr(benchmark.subprocess, "run", really)
    monkeypatch.setattr(benchmark, "PROGRAM", "raise SystemExit(1)")
    again = CliRunner().invoke(benchmark.main, words)
    assert (again.exit_code, again.output) == (0, result.output)
    (tmp_path / "out" / "runs" / "matched-0" / "evaluation.json").unlink()
    assert "learn-matched-0 failed" in CliRunner().invoke(benchmark.main, words).output
