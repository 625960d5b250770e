"""Folders that are found again by what was made in them."""

from __future__ import annotations

import json
from pathlib import Path

from svbrdfgan.config.models import StrictModel
from svbrdfgan.experiments.run_store import SPEC, RunStore


class Spec(StrictModel):
    size: int
    kind: str = "plain"


def test_equal_specifications_share_a_folder(tmp_path: Path) -> None:
    shelf = RunStore(tmp_path, Spec)
    assert shelf.find(Spec(size=1)) is None
    first, other = shelf.place(Spec(size=1), "A row, 1"), shelf.place(Spec(size=2), "A row, 1")
    assert (first.name, other.name) == ("a-row-1", "a-row-1-2")
    assert shelf.place(Spec(size=1), "another") == first
    assert RunStore(tmp_path, Spec).find(Spec(size=2)) == other  # also days later


def test_a_key_that_is_new_makes_no_difference_at_its_default(tmp_path: Path) -> None:
    place = RunStore(tmp_path, Spec).place(Spec(size=1), "x")
    (place / SPEC).write_text(json.dumps({"size": 1}))
    assert RunStore(tmp_path, Spec).find(Spec(size=1)) == place
    assert RunStore(tmp_path, Spec).find(Spec(size=1, kind="fancy")) is None


def test_what_cannot_be_read_is_left_alone(tmp_path: Path) -> None:
    place = RunStore(tmp_path, Spec).place(Spec(size=1), "x")
    (place / SPEC).write_text("{")
    shelf = RunStore(tmp_path, Spec)
    assert shelf.specs == {}
    assert shelf.place(Spec(size=1), "x").name == "x-2"
    assert (place / SPEC).read_text() == "{"
