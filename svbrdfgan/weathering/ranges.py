"""Numeric options of a recipe: defaults, ranges and validation."""

from __future__ import annotations

import math
from dataclasses import field, fields
from typing import TYPE_CHECKING, Any

from svbrdfgan.errors import ConfigError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


def number(default: float, least: float, greatest: float) -> Any:
    """A dataclass field for a number between two bounds. If the default is an int, the number must be one too."""
    return field(default=default, metadata={"least": least, "greatest": greatest})


def check_ranges(recipe: DataclassInstance) -> None:
    """Checks all fields of a recipe that were made by `number`.

    Raises:
        ConfigError: a value is not a number or is out of range; the message names the option, its value and its range.
    """
    for spec in fields(recipe):
        value, least, greatest = getattr(recipe, spec.name), spec.metadata["least"], spec.metadata["greatest"]
        whole = isinstance(spec.default, int)
        wrong = isinstance(value, bool) or not isinstance(value, int if whole else int | float)
        if wrong or not math.isfinite(value) or not least <= value <= greatest:
            kind = "a whole number" if whole else "a number"
            raise ConfigError(f"{spec.name} is {value!r}; wanted {kind} between {least} and {greatest}.")
