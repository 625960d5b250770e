"""Feeds damaged files of every kind to the program, and keeps those that it neither reads nor refuses."""

from __future__ import annotations

import hashlib
import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

from tests.fuzz.judge import SOUND, Judge, Outcome
from tests.fuzz.kinds import Kind
from tests.fuzz.mutations import damaged


@dataclass
class Result:
    """How many inputs of each kind had which outcome, and the failures: path and why, one for each kind and cause."""

    counts: dict[str, Counter[str]] = field(default_factory=dict)
    failures: dict[tuple[str, str, str], tuple[Path, str]] = field(default_factory=dict)

    def table(self) -> str:
        """The counts as lines of text."""
        lines = [f"{kind:18} {sum(counts.values()):6}  {dict(counts)}" for kind, counts in sorted(self.counts.items())]
        total = sum(sum(counts.values()) for counts in self.counts.values())
        return "\n".join([*lines, f"{total} inputs, {len(self.failures)} different failures"])


def fuzz(kinds: Mapping[str, Kind], out: Path, *, seconds: float, seed: int) -> Result:
    """Damages seeds of all kinds in turn, for some seconds, and keeps failures in `out` as KIND-OUTCOME-HASH.

    Args:
        seed: the same one makes the same inputs, in the same order.
    """
    result, until = Result(), time.monotonic() + seconds
    number = 0
    judge = Judge({name: kind.read for name, kind in kinds.items()})
    try:
        while time.monotonic() < until:
            for name, kind in kinds.items():
                random = Random(f"{seed} {name} {number}")
                for _ in range(kind.share):
                    data = damaged(random.choice(kind.seeds), random.choice(kind.seeds), kind.suffix, random)
                    judged(judge, result, out, name, kind, data)
                    if time.monotonic() > until:
                        return result
            number += 1
    finally:
        judge.close()
    return result


def judged(judge: Judge, result: Result, out: Path, name: str, kind: Kind, data: bytes) -> None:
    """Reads a file of a kind, counts its outcome, and keeps it in `out` if that is a failure."""
    outcome = judge.judge(name, kind.place(out / "inputs" / name, data), kind.seconds)
    result.counts.setdefault(name, Counter())[outcome.name] += 1
    if outcome.name not in SOUND:
        _keep(result, out, name, kind, data, outcome)


def _keep(result: Result, out: Path, name: str, kind: Kind, data: bytes, outcome: Outcome) -> None:
    lines = outcome.why.strip().splitlines()
    places = [line.strip() for line in lines if line.lstrip().startswith("File ") and "svbrdfgan" in line]
    cause = places[-1] if places else lines[-1][:40] if lines else ""
    if (name, outcome.name, cause) in result.failures:
        return
    digest = hashlib.sha256(data).hexdigest()[:6]
    path = out / f"{name}-{outcome.name}-{digest}{kind.suffix}"
    path.write_bytes(data)
    result.failures[name, outcome.name, cause] = path, outcome.why
