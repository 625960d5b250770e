"""The figures of docs/results.md are those of the stored results that it names."""

import json
import re
import tarfile
from collections import defaultdict
from pathlib import Path
from statistics import mean
from typing import Any

import pytest

ROW = re.compile(r"^\|[^|]+\|[^|]*\| `([\w-]+)` \|([^|]*)\|([^|]*)\|$", re.MULTILINE)
OUTCOME = re.compile(r"^(?:\./)?runs/([\w-]+?)-(\d+)/outcome\.json$")


@pytest.fixture(scope="module")
def page(repository: Path) -> str:
    return (repository / "docs" / "results.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def fractions(repository: Path) -> dict[str, list[float]]:
    """The fraction of the oracle of each seed, by run, such as `training-matched-default`."""
    found: dict[str, list[float]] = defaultdict(list)
    with tarfile.open(repository / "docs" / "lab" / "gpu.tar.xz") as archive:
        for member in archive:
            named, file = OUTCOME.match(member.name), archive.extractfile(member)
            if named and file:
                record: dict[str, Any] = json.load(file)
                found[named[1]].append(record["evaluation"]["fraction"])
    return found


def test_each_figure_is_the_mean_of_the_stored_runs(page: str, fractions: dict[str, list[float]]) -> None:
    rows = ROW.findall(page)
    assert len(rows) >= 8
    for run, *cells in rows:
        for recipe, cell in zip(("thesis", "default"), cells, strict=True):
            if cell.strip():
                told = float(cell.replace("\\*", ""))
                assert told == pytest.approx(mean(fractions[f"{run}-{recipe}"]), abs=0.006), (run, recipe)


def test_figures_of_one_seed_are_marked(page: str, fractions: dict[str, list[float]]) -> None:
    for run, _, ours in ROW.findall(page):
        assert ("*" in ours) == (len(fractions[f"{run}-default"]) == 1), run
