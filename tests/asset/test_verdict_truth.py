"""Verdicts on real vehicles, against a table that was made by looking at pictures of them.

The table holds, for each file, whether each of its parts should weather. What is not in it does not count: shapes in
two files of a game that only its physics uses, and strips of a bus that no picture shows.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from svbrdfgan.asset.asset import load_asset
from svbrdfgan.asset.verdicts import judge

TRUTH: dict[str, dict[str, bool]] = json.loads((Path(__file__).parent / "verdict_truth.json").read_text())


def judged(path: Path, truth: dict[str, bool]) -> tuple[float, dict[str, float]]:
    """The share of the area that the table knows, and what of it is judged wrongly, by part."""
    known: float = 0.0
    wrong: dict[str, float] = {}
    for verdict in judge(load_asset(path)):
        if verdict.name in truth:
            known += verdict.area
            if verdict.weathers != truth[verdict.name]:
                wrong[verdict.name] = wrong.get(verdict.name, 0.0) + verdict.area
    return known, wrong


@pytest.mark.assets
@pytest.mark.parametrize("folder", ["cars", "full"])
def test_nearly_all_of_the_area_is_judged_rightly(folder: str, assets: Path) -> None:
    files = {name: parts for name, parts in TRUTH.items() if name.startswith(folder)}
    scores = []
    for name, parts in files.items():
        known, wrong = judged(assets / name, parts)
        assert known > 0.3, f"{name}: the table does not know its parts"
        scores.append(1.0 - sum(wrong.values()) / known)
        print(
            f"{name}: {scores[-1]:.3f} of {known:.3f}",
            *(f"\n  wrong: {part} ({area:.3f})" for part, area in wrong.items()),
        )
    print(f"{folder}: {np.mean(scores):.4f} of {len(scores)} vehicles")
    assert np.mean(scores) >= 0.95
