"""Figures are kept by machine and work, and compared with the last ones of the same."""

import json
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

from svbrdfgan import __version__
from svbrdfgan.bench.cases import Case
from svbrdfgan.bench.history import commit_of, comparison, entries_of, read_history, write_history
from svbrdfgan.bench.programs import Figures
from svbrdfgan.bench.run import Result
from svbrdfgan.errors import AssetError, ConfigError

MACHINE = {"processor": "Abacus", "cores": 2}
OURS = Figures("warp", "cpu", {"prepare": 1.0, "forward": 0.5}, {}, {})
RESULT = Result(Case("standard", 2000, 16, 2), 2025, 3872, 0.0, (OURS,), (replace(OURS, name="other 1.0", device=""),))


def test_figures_are_compared_with_the_last_of_such_a_machine(tmp_path: Path) -> None:
    path = tmp_path / "bench.jsonl"
    assert read_history(path) == []
    first = entries_of([RESULT], MACHINE, 16)
    faster = replace(RESULT, backends=(replace(OURS, seconds={"prepare": 1.0, "forward": 0.25}),))
    second = entries_of([faster], MACHINE, 16)
    write_history(path, [*first, *second])
    assert read_history(path) == [*first, *second]
    third = entries_of([RESULT], MACHINE, 16)
    table = comparison(third, read_history(path))
    assert table is not None
    assert [(row[0], row[1], row[-1]) for row in table.rows] == [
        *[("other 1.0", "prepare", "1.00"), ("other 1.0", "forward", "1.00")],
        *[("warp", "prepare", "1.00"), ("warp", "forward", "0.50")],
    ]
    assert comparison(entries_of([RESULT], {**MACHINE, "cores": 4}, 16), first) is None
    assert comparison(entries_of([RESULT], MACHINE, 32), first) is None


def test_the_commit_is_that_of_the_folder(tmp_path: Path) -> None:
    assert commit_of(tmp_path) == __version__
    git = ["git", "-C", str(tmp_path), "-c", "user.name=a", "-c", "user.email=a@example.org"]
    subprocess.run([*git, "init", "-q"], check=True)
    (tmp_path / "a").write_text("1")
    subprocess.run([*git, "add", "a"], check=True)
    subprocess.run([*git, "commit", "-qm", "a"], check=True)
    commit = commit_of(tmp_path)
    assert len(commit) == 12
    (tmp_path / "a").write_text("2")
    assert commit_of(tmp_path) == f"{commit}-dirty"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "is no history of figures"),
        ("[1]", "line 1"),
        (json.dumps({"date": 1}), "line 1"),
        ("[" * 9999, "no history"),
    ],
)
def test_a_file_that_is_no_history_is_told(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "a.jsonl").write_text(text)
    with pytest.raises((AssetError, ConfigError), match=said) as caught:
        read_history(tmp_path / "a.jsonl")
    assert str(tmp_path / "a.jsonl") in str(caught.value)
