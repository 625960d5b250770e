"""Folders that are known by what was made in them: equal specifications share one, also between experiments."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Generic, TypeVar

from svbrdfgan.config.models import StrictModel
from svbrdfgan.errors import SvbrdfganError
from svbrdfgan.io.records import load_record, save_record

SPEC = "spec.json"

Spec = TypeVar("Spec", bound=StrictModel)


class Shelf(Generic[Spec]):
    """The folders below one, each made to the specification in its `spec.json`.

    Specifications are compared as read by this version, so that a key that is new, at its default, makes no difference.
    Folders of specifications that this version cannot read are left alone.
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
        """Where it was made, or begun."""
        return next((self.folder / name for name, held in self.specs.items() if held == spec), None)

    def place(self, spec: Spec, name: str) -> Path:
        """Where it was made or begun, or is to be: a new folder of that name, or one like it.

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
