"""`svbrdfgan models` lists what is shipped, and shows cards."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from svbrdfgan.cli import main
from svbrdfgan.io.records import save_record
from svbrdfgan.models.card import Scores
from svbrdfgan.models.shipped import CARD, load_card


def models(*words: str) -> Result:
    return CliRunner().invoke(main, ["models", *words])


def test_the_list_has_a_line_for_each_model(shipped: Path) -> None:
    result = models()
    assert result.exit_code == 0, result.output
    (line,) = [line for line in result.stdout.splitlines() if line.startswith("corroded")]
    for said in ("Rust or dust, after four steps", "0.25", " MB", str(shipped / "picture.jpg")):
        assert said in line


def test_a_model_without_test_scores_shows_what_it_was_chosen_by(
    shipped_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = shutil.copytree(shipped_folder, tmp_path / "models") / "corroded"
    save_record(folder / CARD, load_card(folder).model_copy(update={"test": Scores()}))
    monkeypatch.setattr("svbrdfgan.models.shipped.FOLDER", folder.parent)
    (line,) = [line for line in models().stdout.splitlines() if line.startswith("corroded")]
    assert "0.50 v" in line


def test_a_card_is_readable(shipped: Path) -> None:
    result = models("corroded")
    assert result.exit_code == 0, result.output
    lines = result.stdout.splitlines()
    assert lines[:2] == ["Corroded (corroded)", "Rust or dust, after four steps of training."]
    for said in (
        "licence: Apache-2.0",
        "trained: svbrdfgan train tiny.yaml -o run",
        "  two procedural vehicles (Apache-2.0)",
        "on test vehicles:",
        "  parts: joint 0.10, mean 0.40",
        "  power by octave, finest first: 0.50, 2.00",
        "  Four steps teach next to nothing.",
    ):
        assert said in lines


def test_programs_get_objects(shipped: Path) -> None:
    (listed,) = json.loads(models("--json").stdout)
    assert listed == json.loads(models("corroded", "--json").stdout)
    assert listed["test"]["resemblance"] == 0.25
    assert Path(listed["picture"]).is_file()
    assert listed["bytes"] == sum(path.stat().st_size for path in shipped.iterdir())


def test_an_unknown_model_is_one_sentence(shipped: Path) -> None:
    result = models("corrode")
    assert result.exit_code == 1
    said = "Error: no model 'corrode' is shipped; did you mean 'corroded'? Shipped are corroded.\n"
    assert result.stderr == said
