"""docs/experiments.md lists every shipped experiment with its size, and its example is a valid experiment."""

import re
from collections.abc import Callable
from pathlib import Path

from svbrdfgan.experiments.columns import speeds, verdicts
from svbrdfgan.experiments.definition import Experiment, experiment_names, load_experiment
from svbrdfgan.experiments.run_matrix import RunMatrix

LISTED = re.compile(r"^\| `([a-z-]+)` \| [^|]*\| (\d+) \| (\d+) \| (\d+) \|", re.MULTILINE)


def page(repository: Path) -> str:
    return (repository / "docs" / "experiments.md").read_text(encoding="utf-8")


def size(name: str) -> tuple[int, int, int]:
    """Rows, runs and minutes of training at most, in the profile gpu."""
    design = RunMatrix.load(name, "gpu")
    cells = design.cells()
    return len(design.experiment.rows), len(cells), round(sum(cell.spec.train.minutes or 0.0 for cell in cells))


def test_the_table_lists_every_experiment_with_its_size(repository: Path) -> None:
    listed = {name: tuple(map(int, numbers)) for name, *numbers in LISTED.findall(page(repository))}
    assert listed == {name: size(name) for name in experiment_names()}


def test_the_example_is_an_experiment(code_blocks: Callable[[str, str], list[str]], tmp_path: Path) -> None:
    (block,) = code_blocks("docs/experiments.md", "yaml")
    path = tmp_path / "cameras.yaml"
    path.write_text(block, encoding="utf-8")
    runs = [len(RunMatrix.load(str(path), profile).cells()) for profile in ("cpu", "gpu")]
    assert runs == [2, 4]


def test_every_key_of_an_experiment_is_explained(repository: Path) -> None:
    table = page(repository).split("| key | meaning |")[1]
    row = load_experiment("training").rows["matched"]
    assert set(re.findall(r"`(\w+)`", table)) >= {*Experiment.model_fields, *type(row).model_fields}


def test_every_column_is_explained(repository: Path) -> None:
    table = page(repository).split("| column | meaning |")[1].split("\n\n")[0]
    named = [name.strip() for row in table.splitlines()[2:] for name in row.split("|")[1].split(";")]
    columns = [*verdicts(("shown", "unseen", "gradient_noise")), *speeds(7, 7.0)]
    assert sorted(named) == sorted(column.heading.replace("7", "N") for column in columns)
