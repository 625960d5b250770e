"""`python -m tests.reliability`: disturbs commands at random moments, and prints a table of what came of it."""

from __future__ import annotations

import argparse
import signal
import sys
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from random import Random

from tests.reliability.bench import Bench
from tests.reliability.commands import COMMANDS, OFTEN, Command

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL)
LIMITS = (0, 300, 3000)
"""Bytes that a file may have on a full disk."""


def by_signals(bench: Bench, command: Command, number: signal.Signals, tries: int, seed: int) -> Iterable[list[str]]:
    """The troubles of each try."""
    rng = Random(f"{seed} {number} {command.words}")
    return (bench.by_signal(command, number, rng.random()) for _ in range(tries))


def disturbances(bench: Bench, command: Command, tries: int, seed: int) -> dict[str, Callable[[], Iterable[list[str]]]]:
    """All ways to disturb a command."""
    found: dict[str, Callable[[], Iterable[list[str]]]] = {
        number.name: lambda number=number: by_signals(bench, command, number, tries, seed)  # type: ignore[misc]
        for number in SIGNALS
    }
    if command.writes:
        found["full disk"] = lambda: (bench.on_full_disk(command, most) for most in LIMITS)
        found["read-only"] = lambda: [bench.in_read_only_folder(command)]
    if command.claims and not command.long:
        found["two at once"] = lambda: [bench.two_at_once(command)]
    return found


def main() -> int:
    """The exit code: 1 after a failure."""
    parser = argparse.ArgumentParser(prog="python -m tests.reliability", description=__doc__)
    parser.add_argument("commands", nargs="*", default=list(COMMANDS), help="by default all")
    parser.add_argument("--moments", type=int, default=20, help="for each signal, of commands that work for long")
    parser.add_argument("--seldom", type=int, default=2, help="for each signal, of the others")
    parser.add_argument("--only", default="", help="disturbances whose name contains this word")
    parser.add_argument("--seed", type=int, default=1)
    given, failed = parser.parse_args(), 0
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(Path(folder) / "bench")
        bench.prepare()
        for name in given.commands:
            tries = given.moments if name in OFTEN else given.seldom
            for what, disturb in disturbances(bench, COMMANDS[name], tries, given.seed).items():
                if given.only not in what:
                    continue
                count, bad = 0, 0
                for troubles in disturb():
                    count, bad = count + 1, bad + bool(troubles)
                    for trouble in troubles:
                        print(f"    {trouble}", flush=True)
                failed += bad
                print(f"| {name} | {what} | {count} | {bad} |", flush=True)
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
