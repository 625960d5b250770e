"""Finds the folders of data sets, oracles and runs by the specification of their contents.

Equal specifications share a folder, also between experiments.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Generic, TypeVar

from svbrdfgan.config.models import StrictModel, differences
from svbrdfgan.errors import ConfigError, SvbrdfganError
from svbrdfgan.experiments.run_matrix import RunMatrix, RunSpec
from svbrdfgan.io.records import load_record, save_record

SPEC = "spec.json"  # in each folder of a `RunStore`
DEFINITION = "definition.json"

Spec = TypeVar("Spec", bound=StrictModel)


class RunStore(Generic[Spec]):
    """The folders below one folder, each with its specification in `spec.json`.

    Specifications are compared as this version reads them, so that a new key with its default value makes no
    difference. Folders whose specification this version cannot read are ignored.
    """

    def __init__(self, folder: Path, model: type[Spec]) -> None:
        self.folder = folder
        self.specs: dict[str, Spec] = {}
        for path in sorted(folder.glob(f"*/{SPEC}")):
            try:
                self.specs[path.parent.name] = load_record(model, path)
            except SvbrdfganError:
                continue

    def find(self, spec: Spec) -> Path | None:
        """The folder with this specification, complete or not; None if there is none."""
        return next((self.folder / name for name, held in self.specs.items() if held == spec), None)

    def place(self, spec: Spec, name: str) -> Path:
        """The folder with this specification; else a new folder of that name, numbered if the name is taken.

        Raises:
            AssetError: the disk cannot be written.
        """
        found = self.find(spec)
        if found is not None:
            return found
        stem = re.sub(r"[^a-z0-9.]+", "-", name.lower()).strip("-")
        number, free = 1, stem
        while (self.folder / free).exists():
            number, free = number + 1, f"{stem}-{number + 1}"
        save_record(self.folder / free / SPEC, spec)
        self.specs[free] = spec
        return self.folder / free


class Provenance(StrictModel):
    """The contents of `definition.json`: the specification of every row by every recipe, with seed 0."""

    profile: str
    rows: dict[str, RunSpec]


def record_provenance(matrix: RunMatrix, root: Path) -> None:
    """Writes the specifications of all rows into `root/NAME`, or checks that those written earlier are equal.

    Raises:
        ConfigError: the existing results are of another definition.
    """
    rows = {f"{cell.row}/{cell.recipe}": cell.spec for cell in matrix.cells(seeds=[0])}
    mine = Provenance(profile=matrix.profile_name, rows=rows)
    folder = root / matrix.name
    path = folder / DEFINITION
    if not path.is_file():
        save_record(path, mine)
        return
    try:
        its = load_record(Provenance, path)
        changed = differences(mine.model_dump(mode="json"), its.model_dump(mode="json"))
    except SvbrdfganError:
        changed = ["a key that this version does not know"]
    if changed:
        raise ConfigError(
            f"{folder} holds results of another definition ({changed[0]}); choose another folder, or delete {folder}: "
            f"runs that fit are taken from {root / 'runs'}."
        )
