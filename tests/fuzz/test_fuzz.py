"""Damaged files of every kind are read, or refused in one printable sentence, in seconds and bounded memory."""

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest

from svbrdfgan.errors import AssetError
from tests.fuzz.fuzz import fuzz
from tests.fuzz.judge import SOUND, Judge
from tests.fuzz.kinds import Kind
from tests.fuzz.mutations import damaged
from tests.fuzz.seeds import all_kinds
from tests.fuzz.sweep import sweep

CORPUS = sorted((Path(__file__).parent / "corpus").iterdir())
"""Files that broke the program once, named KIND-WHAT."""


def refuses(message: str) -> Any:
    def read(path: Path) -> None:
        raise AssetError(message)

    return read


@pytest.fixture(scope="module")
def kinds(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Kind]:
    return all_kinds(tmp_path_factory.mktemp("seeds"))


@pytest.fixture(scope="module")
def judge(kinds: dict[str, Kind]) -> Iterator[Judge]:
    made = Judge({name: kind.read for name, kind in kinds.items()})
    yield made
    made.close()


def test_each_way_to_fail_is_told_apart() -> None:
    wrong = {
        "read": lambda path: None,
        "refused": refuses("a.glb is cut short."),
        "wordless": refuses(""),
        "traceback": lambda path: {}["key"],
        "memory": lambda path: np.ones(140_000_000)[0],
        "hang": lambda path: time.sleep(60),
        "killed": lambda path: os.kill(os.getpid(), signal.SIGKILL),
    }
    judge = Judge(wrong)
    for name in [*wrong, "read"]:  # and the worker is started again
        outcome = judge.judge(name, Path("a"), 1.0 if name == "hang" else 60.0)
        assert outcome.name == name
        assert name != "hang" or "test_fuzz.py" in outcome.why, "it says where"
    judge.close()


def test_damages_are_the_same_for_a_seed() -> None:
    data = [damaged(b'{"a": [1, 2]}', b"other", ".json", Random(7)) for _ in range(2)]
    assert data[0] == data[1]


@pytest.mark.full
def test_whole_files_of_all_kinds_are_read(kinds: dict[str, Kind], judge: Judge, tmp_path: Path) -> None:
    for name, kind in kinds.items():
        for seed in kind.seeds:
            outcome = judge.judge(name, kind.place(tmp_path / name, seed), 60.0)
            assert outcome.name == "read", (name, outcome.why)


@pytest.mark.full
@pytest.mark.parametrize("path", CORPUS, ids=lambda path: path.name)
def test_what_broke_it_once_does_not_again(kinds: dict[str, Kind], judge: Judge, tmp_path: Path, path: Path) -> None:
    name = next(name for name in sorted(kinds, key=len, reverse=True) if path.name.startswith(f"{name}-"))
    outcome = judge.judge(name, kinds[name].place(tmp_path, path.read_bytes()), 60.0)
    assert outcome.name in SOUND, outcome.why


@pytest.mark.full
def test_a_minute_of_damage_breaks_nothing(kinds: dict[str, Kind], tmp_path: Path) -> None:
    result = fuzz(kinds, tmp_path, seconds=60, seed=1)
    assert not result.failures, result.failures
    assert result.counts.keys() == kinds.keys()


@pytest.mark.full
@pytest.mark.parametrize(("name", "least"), [("notes", 100), ("gltf", 10_000)])
def test_no_odd_value_of_a_record_breaks_anything(
    kinds: dict[str, Kind], name: str, least: int, tmp_path: Path
) -> None:
    result = sweep({name: kinds[name]}, tmp_path)
    assert not result.failures, result.failures
    assert sum(result.counts[name].values()) >= least
