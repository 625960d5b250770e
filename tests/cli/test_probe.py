"""`svbrdfgan probe` on the tiny data set: what it prints and writes, and its one sentence where it cannot."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from svbrdfgan.cli import main

Data = Callable[..., dict[str, Any]]


def probe(training: dict[str, Any], folder: Path, *words: object) -> Result:
    (folder / "train.yaml").write_text(json.dumps(training))
    return CliRunner().invoke(main, ["probe", str(folder / "train.yaml"), *map(str, words)])


def test_a_table_and_two_files(training_data: Data, tmp_path: Path) -> None:
    result = probe(training_data(), tmp_path, "scenes.environment=redrawn", "--minutes", 0.01, "-o", tmp_path / "out")
    assert result.exit_code == 0, result.output
    title, head, *rows = [re.split(r"\s{2,}", line) for line in result.stdout.splitlines()[:7]]
    assert title == ["share of 2 pairs of unweathered pictures in which the real one was recognised"]
    assert head == ["confounder", "real and fake", "verdict", "99 % interval"]
    assert [row[0] for row in rows] == ["pose", "light", "noise", "renderer", "all together"]
    assert rows[1][1] == "fakes' lights are drawn again from the exemplars' distribution"
    assert re.fullmatch(r"(leaks|no leak): \d+%", rows[1][2])
    assert rows[0][2] == "the same on both sides"
    assert result.stdout.splitlines()[-1] == f"written to {tmp_path / 'out'}"
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["pairs.png", "probe.json"]
    assert json.loads((tmp_path / "out" / "probe.json").read_text())["exemplars"] == 6


def test_the_title_says_that_true_layers_were_shown(training_data: Data, tmp_path: Path) -> None:
    result = probe(training_data(), tmp_path, "--true-layers", "--minutes", 0.01, "-o", tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert result.stdout.splitlines()[0].strip().startswith("share of 2 pairs of pictures of true layers in which")
    assert json.loads((tmp_path / "out" / "probe.json").read_text())["layers"] == "true"


def test_nothing_is_written_unasked(training_data: Data, tmp_path: Path) -> None:
    result = probe(training_data(), tmp_path, "--device", "cpu", "--minutes", 0.01)
    assert result.exit_code == 0, result.output
    assert "No shortcut was found that tells more than" in result.stdout
    assert [path.name for path in tmp_path.iterdir()] == ["train.yaml"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("stesp=3",), "unknown key 'stesp'"),
        (("dataset=nowhere",), "is not a data set"),
        (("renderer={name: numpy, max_bounces: 2}",), "set rendering: online or choose another renderer"),
    ],
)
def test_a_failure_is_one_sentence(words: tuple[str, ...], said: str, training_data: Data, tmp_path: Path) -> None:
    result = probe(training_data(), tmp_path, *words, "-o", tmp_path / "out")
    assert (result.exit_code, result.stdout) == (1, "")
    assert said in result.stderr.splitlines()[-1]
    assert not (tmp_path / "out").exists()
