"""`svbrdfgan dataset import`: a sibling of `dataset CONFIG`, and a page whose example is a manifest."""

from __future__ import annotations

import re
from pathlib import Path

import click
import pytest
import yaml
from click.testing import CliRunner, Result

from svbrdfgan.cli import main
from svbrdfgan.data.exemplars import load_exemplars
from svbrdfgan.data.index import Dataset
from svbrdfgan.data.photos.manifest import read_manifest
from svbrdfgan.training.config import train_config

PAGE = Path(__file__).parents[2] / "docs" / "own-pictures.md"


def invoke(*words: object) -> Result:
    return CliRunner().invoke(main, [str(word) for word in words])


def test_it_makes_a_data_set_and_says_what_to_look_at(manifest: Path, tmp_path: Path) -> None:
    result = invoke("dataset", "import", manifest, "-o", tmp_path / "own", "image=[32, 24]")
    assert result.exit_code == 0, result.output
    said = r"^overlay/0000.png: van.jpg: IoU 0\.\d\d, exposure x [\d.]+, reflectance within \d+%$"
    assert re.search(said, result.stdout, re.MULTILINE)
    assert "contact-sheet.png" in result.stdout
    assert "train: 1 exemplars of 1 meshes" in result.stdout
    assert "warning: van.jpg: mask and mesh agree by 0." in result.stderr
    assert load_exemplars(Dataset.open(tmp_path / "own"), "train").images.shape == (1, 24, 32, 3)
    again = invoke("dataset", "import", manifest, "-o", tmp_path / "own")
    assert again.exit_code == 1
    assert "holds more than overlays" in again.stderr


def test_errors_are_lines_on_stderr(manifest: Path, tmp_path: Path) -> None:
    result = invoke(
        "dataset", "import", manifest, "-o", tmp_path / "own", "embedding=spherical", "learnable.include=[x]"
    )
    assert (result.exit_code, result.stdout) == (1, "")
    lines = [line for line in result.stderr.splitlines() if "manifest.yaml:" in line]
    assert len(lines) == 2
    assert lines[0].startswith("Error: ")
    assert list(tmp_path.iterdir()) == []


def test_the_command_for_distributions_is_as_it_was() -> None:
    command = main.get_command(click.Context(main), "dataset")
    assert command is not None
    plain = command.make_context("dataset", ["import.yaml", "spp=16", "-o", "out"])
    assert plain.params["config"] == Path("import.yaml")
    assert plain.params["overrides"] == ("spp=16",)
    assert command.make_context("dataset", ["./import", "-o", "out"]).params["config"] == Path("import")
    other = command.make_context("dataset", ["import", "m.yaml", "-o", "out", "--preview"])
    assert other.params["manifest"] == Path("m.yaml")
    with pytest.raises(click.UsageError):
        command.make_context("dataset", ["import", "m.yaml", "-o", "out", "--dry-run"])


def test_all_commands_are_in_the_help() -> None:
    text = invoke("dataset", "--help").stdout
    assert "dataset import MANIFEST" in text
    assert "dataset pose IMAGES" in text
    text = invoke("dataset", "import", "--help").stdout
    assert "Usage: svbrdfgan dataset import" in text.replace("main", "svbrdfgan")
    assert "--preview" in text


def test_the_page_s_files_are_right() -> None:
    own, pairs, captured, training = (
        yaml.safe_load(block) for block in re.findall(r"^```yaml\n(.*?)^```", PAGE.read_text(), re.M | re.S)
    )
    assert len(read_manifest(own, "page").pictures) > 1
    assert all(picture.second for picture in read_manifest(pairs, "page").pictures)
    assert len(read_manifest(captured, "page").captures) > 1
    assert train_config({"dataset": "exemplars", **training}, "page").scenes.matched


def test_the_page_s_commands_parse() -> None:
    blocks = "\n".join(re.findall(r"^```sh\n(.*?)^```", PAGE.read_text(), re.MULTILINE | re.DOTALL))
    calls = [line.split("#")[0].split()[1:] for line in blocks.splitlines() if line.startswith("svbrdfgan ")]
    assert len(calls) > 2
    for name, *arguments in calls:
        command = main.get_command(click.Context(main), name)
        assert command is not None
        command.make_context(name, arguments)
