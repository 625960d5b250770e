"""What the names of materials and nodes tell of a vehicle: which parts are glass, wheels, in front or at the rear."""

from __future__ import annotations

import re
from collections.abc import Sequence
from types import MappingProxyType

import numpy as np
from jaxtyping import Bool
from numpy import ndarray

_WORDS = MappingProxyType(
    {
        "glass": r"glass|window|wind ?screen|wind ?shield",
        "wheel": r"wheel|tyre|\btires?\b|\brims?\b|car ?tire",
        "front": r"head ?lights?|head ?lamps?|\bfront|lights? ?front|bonnet|\bhood\b|grill",
        "rear": r"tail|\brear|\bback\b|lights? ?back|exhaust|muffler|\btrunk\b|brake ?lights?|reverse ?lights?|spoiler",
    }
)
_NOT = re.compile(r"steering|spare|underside|trim|seat|entertain|background|feedback")


def named_parts(names: Sequence[str]) -> dict[str, Bool[ndarray, " parts"]]:
    """For each of "glass", "wheel", "front" and "rear", which of the names say it.

    A name that says both front and rear says neither.
    """
    plain = [_plain(name) for name in names]
    found = {
        what: np.array([bool(re.search(words, name)) and not _NOT.search(name) for name in plain], dtype=bool)
        for what, words in _WORDS.items()
    }
    both = found["front"] & found["rear"]
    return found | {"front": found["front"] & ~both, "rear": found["rear"] & ~both}


def _plain(name: str) -> str:
    """The name in lower case, with its words apart: `RRRX7VS__BrakeLight2` is `rrrx7 vs brake light 2`."""
    apart = re.sub(r"(?<=[a-z])(?=[A-Z0-9])|(?<=[A-Z0-9])(?=[A-Z][a-z])|[_\W]+", " ", name)
    return " ".join(apart.lower().split())
