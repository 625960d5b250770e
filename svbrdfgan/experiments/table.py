"""The files of results: `table.md` and its pictures for people, `results.json` for programs."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterable, Sequence
from pathlib import Path

from svbrdfgan.experiments.columns import Column
from svbrdfgan.experiments.contact_strip import CONTACT_STRIP, write_contact_sheet
from svbrdfgan.experiments.results import Results, TableLine
from svbrdfgan.io.atomic import atomic_path
from svbrdfgan.utils.printable import printable

TABLE = "table.md"
RESULTS = "results.json"
SHEET = "pictures.png"  # all strips, which the table shows
PICTURES = "pictures"  # the folder of the strips


def write_results(folder: Path, results: Results) -> None:
    """Writes all files into the folder and replaces those of earlier results.

    Raises:
        AssetError: a file cannot be written.
    """
    _write(folder / RESULTS, json.dumps(results.record(), indent=1) + "\n")
    strips = _strips(folder / PICTURES, results.lines)
    if strips:
        write_contact_sheet(folder / SHEET, strips)
    _write(folder / TABLE, page(results, pictures=bool(strips)))


def page(results: Results, *, pictures: bool) -> str:
    """The contents of `table.md`."""
    matrix, columns = results.matrix, [*results.verdicts(), *results.speeds()]
    experiment = matrix.experiment
    parts = [
        f"# {experiment.title}",
        f"Reproduces {experiment.figure} of the thesis. The thesis: {experiment.thesis.strip()}",
        f"Profile `{matrix.profile_name}`: {matrix.profile.about.strip()}",
        _changed("All rows differ from that by", matrix.common),
        "## How well each row learned",
        _table(results.verdicts(), results.lines),
        _spread(results),
        _oracles(results),
        _absent(results.lines),
        "## How fast",
        _table(results.speeds(), results.lines),
        f"Scores are of the validation split here, of the test split above. {_machines(results)}",
        "## What the rows are",
        "\n".join(_row(results, name) for name in experiment.rows),
        "The recipe `default` is this project's; `thesis` is the thesis's own: WGAN-GP, five critic steps, batch 1.",
        "## Pictures" if pictures else "",
        f"Two vehicles that were never trained on, by the first seed.\n\n![]({SHEET})" if pictures else "",
        "## What the columns are",
        "\n".join(f"- **{column.heading}**: {column.meaning}" for column in columns),
        "## The runs",
        "\n".join(_runs(results.lines)),
    ]
    return printable("\n\n".join(part for part in parts if part) + "\n", breaks=True)


def _table(columns: Sequence[Column], lines: Iterable[TableLine]) -> str:
    head = ["row", "recipe", "seeds", *(column.heading for column in columns)]
    rows = [
        [line.row, line.recipe, str(len(line.outcomes)), *(_cell(column, line) for column in columns)]
        for line in lines
        if line.outcomes
    ]
    ruler = ["---", "---", *["---:"] * (len(head) - 2)]
    shown = [[printable(cell).replace("|", r"\|") for cell in row] for row in [head, ruler, *rows]]
    return "\n".join("| " + " | ".join(row) + " |" for row in shown)


def _cell(column: Column, line: TableLine) -> str:
    """Mean and standard deviation, and the number of runs that have a value if not all do."""
    statistic = column.over(line.outcomes)
    if statistic is None:
        return column.absent
    spread = "" if statistic.deviation is None else f" ± {statistic.deviation:{column.form}}"
    partly = "" if statistic.count == statistic.of else f" ({statistic.count} of {statistic.of})"
    return f"{statistic.mean:{column.form}}{spread}{partly}"


def _row(results: Results, name: str) -> str:
    about = results.matrix.experiment.rows[name].about.strip()
    return f"- **{name}**: {about} {_changed('Sets', results.matrix.changes(name))}".rstrip()


def _changed(intro: str, overrides: Iterable[str]) -> str:
    listed = ", ".join(f"`{override}`" for override in overrides)
    return f"{intro} {listed}." if listed else ""


def _spread(results: Results) -> str:
    several = any(len(line.outcomes) > 1 for line in results.lines)
    return "Mean ± standard deviation over the seeds." if several else "One seed each: small differences mean nothing."


def _oracles(results: Results) -> str:
    """Also names the oracles that stopped while their scores still rose, so that these are too low a ceiling."""
    if not results.matrix.experiment.oracles:
        return ""
    lines = results.lines
    oracles = {_label(line): [outcome.evaluation.oracle for outcome in line.outcomes] for line in lines}
    found = [label for label, its in oracles.items() if any(each and each.plateau is False for each in its)]
    rising = f" Its steps ran out while it was still rising in: {'; '.join(found)}." if found else ""
    return f"One oracle serves all rows with the same data and generator.{rising}"


def _absent(lines: Iterable[TableLine]) -> str:
    found = [_label(line) for line in lines if not line.runs]
    return f"Not run yet: {'; '.join(found)}." if found else ""


def _machines(results: Results) -> str:
    """Names devices, runs at once and versions. Seconds are comparable only for equal device and runs at once."""
    found = dict.fromkeys(f"{o.device}, {o.jobs} at once" for o in results.outcomes)
    mixed = " These differ, so compare seconds only where they agree." if len(found) > 1 else ""
    made = dict.fromkeys(", ".join(f"{name} {of}" for name, of in o.versions.items()) for o in results.outcomes)
    several = f" Several versions made them: {'; '.join(made)}." if len(made) > 1 else ""
    return f"Seconds are those of runs on {'; '.join(found)}.{mixed}{several}" if found else ""


def _runs(lines: Iterable[TableLine]) -> Iterable[str]:
    for line in lines:
        for run in line.runs:
            result = (
                f"[report](../runs/{run.folder.name}/report.html)" if run.reason is None else f"failed: {run.reason}"
            )
            yield printable(f"- {_label(line)}, seed {run.seed}: {result}")


def _label(line: TableLine) -> str:
    return f"{line.row}, {line.recipe}"


def _strips(folder: Path, lines: Iterable[TableLine]) -> dict[str, Path]:
    """Copies of the contact strip of each line's first run, by the line's label."""
    strips = {}
    for line in lines:
        first = next((run for run in line.runs if (run.folder / CONTACT_STRIP).is_file()), None)
        if first is not None:
            strips[_label(line)] = path = folder / f"{line.row}-{line.recipe}.png"
            folder.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(first.folder / CONTACT_STRIP, path)
    return strips


def _write(path: Path, text: str) -> None:
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
