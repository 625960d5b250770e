"""What the results in a folder are of: written down at first, and held to."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

from svbrdfgan.config.models import StrictModel
from svbrdfgan.errors import ConfigError, SvbrdfganError
from svbrdfgan.experiments.run_matrix import Design, RunSpec
from svbrdfgan.io.records import load_record, save_record

DEFINITION = "definition.json"


class Declared(StrictModel):
    """The contents of `definition.json`: every row by every recipe, all with seed 0."""

    profile: str
    rows: dict[str, RunSpec]


def keep_definition(design: Design, root: Path) -> None:
    """Writes down what the results in `root/NAME` will be of.

    Raises:
        ConfigError: those there are of something else.
    """
    rows = {f"{cell.row}/{cell.recipe}": cell.spec for cell in design.cells(seeds=[0])}
    mine = Declared(profile=design.profile_name, rows=rows)
    folder = root / design.name
    path = folder / DEFINITION
    if not path.is_file():
        save_record(path, mine)
        return
    try:
        changed = _difference(mine, load_record(Declared, path))
    except SvbrdfganError:
        changed = "a key that this version does not know"
    if changed:
        raise ConfigError(
            f"{folder} holds results of another definition ({changed}); choose another folder, or delete {folder}: "
            f"what fits among {root / 'runs'} is used again."
        )


def _difference(mine: Declared, its: Declared) -> str | None:
    """A key that differs; None if none does."""
    now, before = (set(_flat(each.model_dump(mode="json"))) for each in (mine, its))
    return next((key for key, _ in sorted(now ^ before)), None)


def _flat(data: object, path: str = "") -> Iterator[tuple[str, str]]:
    """Dotted keys, and their values as text."""
    if isinstance(data, dict) and data:
        for key, value in data.items():
            yield from _flat(value, f"{path}.{key}" if path else key)
    else:
        yield path, json.dumps(data)
