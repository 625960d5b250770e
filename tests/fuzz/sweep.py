"""Every value of every record, in turn, replaced by everything odd: what random damage meets only by chance."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from pathlib import Path

from tests.fuzz.fuzz import Result, judged
from tests.fuzz.judge import Judge
from tests.fuzz.kinds import Kind
from tests.fuzz.mutations import ODD, places
from tests.fuzz.trees import OPENED

_LONG = 100
"""Letters of text that is too long to be put everywhere."""


def sweep(kinds: Mapping[str, Kind], out: Path) -> Result:
    """Reads all such files of the kinds that hold JSON or YAML, and keeps failures in `out`, as `fuzz` does."""
    result, judge = Result(), Judge({name: kind.read for name, kind in kinds.items()})
    try:
        for name, kind in kinds.items():
            for data in _each(kind.seeds[0], kind.suffix):
                judged(judge, result, out, name, kind, data)
    finally:
        judge.close()
    return result


def _each(data: bytes, suffix: str) -> Iterator[bytes]:
    """The file with another value in one place, for each place and value; none if it holds no tree."""
    if suffix not in OPENED:
        return
    tree, pack = OPENED[suffix](data)
    for number in range(len(places(tree))):
        for value in ODD:
            if isinstance(value, str) and len(value) > _LONG:
                continue
            changed = copy.deepcopy(tree)
            container, key = places(changed)[number]
            container[key] = copy.deepcopy(value)
            yield pack(changed)
