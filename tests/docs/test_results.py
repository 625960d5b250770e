"""The stored results behind docs/results.md belong to rows that are still declared."""

import tarfile
from pathlib import Path

from svbrdfgan.experiments.definition import experiment_names
from svbrdfgan.experiments.outcome import RunOutcome
from svbrdfgan.experiments.run_matrix import RunMatrix, RunSpec
from svbrdfgan.experiments.run_store import RunStore

RESULTS = Path(__file__).parents[2] / "docs" / "results" / "gpu.tar.xz"


def test_kept_results_are_those_of_declared_rows(tmp_path: Path) -> None:
    """So `svbrdfgan experiment` can continue from them. After a default has changed, they must be run again."""
    with tarfile.open(RESULTS) as archive:
        archive.extractall(tmp_path, filter="data")
    runs = RunStore(tmp_path / "runs", RunSpec)
    kept = list((tmp_path / "runs").iterdir())
    cells = [cell for name in experiment_names() for cell in RunMatrix.load(name, "gpu").cells()]
    found = {runs.find(cell.spec) for cell in cells} - {None}
    assert found == set(kept)
    assert all(0 < RunOutcome.load(folder).evaluation.seen <= 1 for folder in kept)
