"""Numbers that a recipe may be given: their defaults, their ranges, and a clear refusal of anything else."""

from __future__ import annotations

import math
from dataclasses import field, fields
from typing import TYPE_CHECKING, Any

from svbrdfgan.errors import ConfigError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


def number(default: float, least: float, greatest: float) -> Any:
    """A dataclass field that holds a number between two bounds; a whole one if its default is."""
    return field(default=default, metadata={"least": least, "greatest": greatest})


def check_ranges(recipe: DataclassInstance) -> None:
    """Refuse values that are no numbers, or out of range.

    Raises:
        ConfigError: names the option, what was given and what would be right.
    """
    for spec in fields(recipe):
        value, least, greatest = getattr(recipe, spec.name), spec.metadata["least"], spec.metadata["greatest"]
        whole = isinstance(spec.default, int)
        wrong = isinstance(value, bool) or not isinstance(value, int if whole else int | float)
        if wrong or not math.isfinite(value) or not least <= value <= greatest:
            kind = "a whole number" if whole else "a number"
            raise ConfigError(f"{spec.name} is {value!r}; wanted {kind} between {least} and {greatest}.")
