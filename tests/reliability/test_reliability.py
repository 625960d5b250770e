"""Each command, however it is disturbed, ends with one sentence, leaves nothing, and goes on when it is called again.

SVBRDFGAN_MOMENTS says at how many random moments each signal comes; `python -m tests.reliability` prints a table. Most
commands that are used seldom, and all limits of a full disk but one, are tried with `-m slow`.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest

from svbrdfgan.cli import COMMANDS as ALL
from tests.reliability.__main__ import LIMITS, SIGNALS, by_signals
from tests.reliability.bench import Bench
from tests.reliability.commands import COMMANDS, OFTEN

MOMENTS = int(os.environ.get("SVBRDFGAN_MOMENTS", "1"))
ALWAYS = (OFTEN.keys() - {"experiment"}) | {"backends", "bake", "parts"}
"""Not slow: what is used often, but `experiment`, which takes a minute each time; and of all others those that start
processes, write or read in some seconds."""


def tried(names: Iterable[str]) -> list[Any]:
    return [name if name in ALWAYS else pytest.param(name, marks=pytest.mark.slow) for name in names]


ALL_COMMANDS = tried(COMMANDS)
WRITING = tried(name for name, command in COMMANDS.items() if command.writes and not command.long)
CLAIMING = tried(name for name, command in COMMANDS.items() if command.claims and not command.long)
FULL = [each if each == LIMITS[1] else pytest.param(each, marks=pytest.mark.slow) for each in LIMITS]

pytestmark = [
    pytest.mark.full,
    pytest.mark.timeout(3600),
    pytest.mark.skipif(sys.platform != "linux", reason="processes are found in /proc"),
    pytest.mark.skipif(
        not {"warp", "mitsuba"} <= {*os.environ.get("SVBRDFGAN_REQUIRED_BACKENDS", "").split()},
        reason="the commands need warp and mitsuba",
    ),
]


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    made = Bench(tmp_path_factory.mktemp("reliability") / "bench")
    made.prepare()
    return made


def test_every_command_is_disturbed() -> None:
    assert {name.split()[0] for name in COMMANDS} == {*ALL}


@pytest.mark.parametrize("number", SIGNALS, ids=lambda number: number.name)
@pytest.mark.parametrize("name", ALL_COMMANDS)
def test_signals_at_random_moments(bench: Bench, name: str, number: signal.Signals) -> None:
    tries = MOMENTS if name in OFTEN else min(MOMENTS, 2)
    assert [trouble for each in by_signals(bench, COMMANDS[name], number, tries, seed=1) for trouble in each] == []


@pytest.mark.parametrize("most", FULL)
@pytest.mark.parametrize("name", WRITING)
def test_a_full_disk(bench: Bench, name: str, most: int) -> None:
    assert bench.on_full_disk(COMMANDS[name], most) == []


@pytest.mark.parametrize("name", WRITING)
def test_a_read_only_folder(bench: Bench, name: str) -> None:
    assert bench.in_read_only_folder(COMMANDS[name]) == []


@pytest.mark.parametrize("name", CLAIMING)
def test_two_at_once(bench: Bench, name: str) -> None:
    assert bench.two_at_once(COMMANDS[name]) == []


@pytest.mark.parametrize("words", [["models"], ["models", "--json"], ["--help"]])
def test_results_that_nobody_can_take(words: list[str], tmp_path: Path) -> None:
    with Path("/dev/full").open("w") as full:
        ended = subprocess.run(
            [sys.executable, "-m", "svbrdfgan", *words], stdout=full, stderr=subprocess.PIPE, text=True
        )
    assert (ended.returncode, ended.stderr) == (1, "Error: No space left on device.\n")
