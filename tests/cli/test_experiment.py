"""`svbrdfgan experiment`: what it lists, and the one sentence where it cannot."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from svbrdfgan.cli import main
from svbrdfgan.experiments.definition import experiment_names


def invoke(*words: object) -> Result:
    return CliRunner(env={"SVBRDFGAN_ASSETS": "", "COLUMNS": "160"}).invoke(main, ["experiment", *map(str, words)])


@pytest.mark.parametrize("profile", ["cpu", "gpu"])
def test_the_list_names_all(profile: str) -> None:
    result = invoke("--list", "--profile", profile)
    assert result.exit_code == 0, result.output
    for name in experiment_names():
        assert f"\n{name} " in result.stdout


def test_a_name_and_a_folder_are_wanted(tmp_path: Path) -> None:
    for words in ((), ("training",), ("-o", tmp_path)):
        result = invoke(*words)
        assert result.exit_code == 2
        assert "`svbrdfgan experiment --list` shows the names" in result.stderr


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (("trainin",), 1, "there is no experiment 'trainin'; did you mean 'training'?"),
        (
            ("training", "--only", "training/macthed"),
            1,
            "no run matches 'training/macthed'; did you mean 'training/match",
        ),
        (("training", "--profile", "gpu"), 1, "give --assets"),
        (("training", "train.stepps=3"), 1, "unknown key 'stepps'; did you mean 'steps'?"),
        (("training", "--seeds", "one"), 2, "'one' is no list such as 0,1,2."),
    ],
)
def test_a_mistake_is_reported_and_nothing_written(
    words: tuple[str, ...], code: int, said: str, tmp_path: Path
) -> None:
    result = invoke(*words, "-o", tmp_path / "out")
    assert result.exit_code == code, result.output
    assert said in result.stderr
    assert result.stdout == ""
    assert not (tmp_path / "out").exists()
