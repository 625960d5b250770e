"""The table for people, for documents and for programs."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from itertools import groupby
from typing import Any

import numpy as np
from jaxtyping import Bool
from numpy import ndarray
from rich import box
from rich.markup import escape
from rich.table import Table as RichTable

from svbrdfgan.testing.pairs.compare import Comparison
from svbrdfgan.testing.pairs.table import STORED, Row

_HEAD = ("pair", "|z| / limit", "picture apart", "furthest apart", "finds: sum, block", "samples", "verdict")
_NARROW = ("pair", "|z| / limit", "finds: sum, block", "verdict")
WIDE = 140
"""Columns that the whole table takes."""

_STYLES = {"agree": "green", "skipped": "yellow"}

CAPTION = (
    f"{STORED} by its stored reference.  |z|: of the furthest of all cells, with the |z| that is a disagreement.  "
    "Picture apart: of its sum, with the standard error.  Finds: the least bias found with 95 % power, in the worst "
    "sum and in the worst block of at least 1 %.  Samples: of each, for the quantity that took most."
)
"""The meaning of the columns."""


def rich_table(rows: Iterable[Row], width: int) -> RichTable:
    """The table for a terminal of 80 columns and more; the whole of it from `WIDE` columns on."""
    table = RichTable(box=box.SIMPLE_HEAD, pad_edge=False, caption=CAPTION, caption_justify="left")
    shown = [at for at, name in enumerate(_HEAD) if width >= WIDE or name in _NARROW]
    for at in shown:
        table.add_column(_HEAD[at], no_wrap=True)
    for scene, found in groupby(rows, key=lambda row: row.scene):
        table.add_row(f"[bold]{scene}[/]")
        for row in found:
            texts = [escape(text) for text in _texts(row)]
            pair, *texts, verdict = (texts[at] for at in shown)
            table.add_row(f"  {pair}", *texts, f"[{_STYLES.get(row.verdict, 'bold red')}]{verdict}[/]")
        table.add_section()
    return table


def markdown(rows: Iterable[Row]) -> str:
    """The table for a document."""
    lines = [["scene", *_HEAD], ["---"] * (len(_HEAD) + 1), *([row.scene, *_texts(row)] for row in rows)]
    return "".join("| " + " | ".join(text.replace("|", "\\|") for text in line) + " |\n" for line in lines)


def explanations(rows: Iterable[Row]) -> Iterator[str]:
    """Yields one line or more for every row that was skipped or failed, which say why."""
    for row in rows:
        name = f"{row.scene}, {' and '.join(row.pair)}" if row.pair else row.scene
        if row.reason:
            yield f"{name}: {row.reason}"
        for comparison in row.comparisons if row.failed else ():
            yield from (f"{name}: {text}" for text in _faults(comparison))


def record(row: Row) -> dict[str, Any]:
    """The row as JSON values, with all its cells."""
    return {
        "scene": row.scene,
        "pair": list(row.pair),
        "verdict": row.verdict,
        "reason": row.reason,
        "samples": list(row.samples),
        "quantities": {comparison.quantity: _cells(comparison) for comparison in row.comparisons},
    }


def as_json(rows: Iterable[Row]) -> str:
    return json.dumps([record(row) for row in rows], indent=2)


def _cells(comparison: Comparison) -> list[Mapping[str, Any]]:
    numbers = (comparison.difference, comparison.error, comparison.z, comparison.limit, comparison.finds)
    keys = ("difference", "error", "z", "limit", "finds")
    return [
        {"block": label, **{key: float(f"{values[at]:.4g}") for key, values in zip(keys, numbers, strict=True)}}
        for at, label in enumerate(comparison.labels)
    ]


def _texts(row: Row) -> list[str]:
    pair = ", ".join(row.pair)
    if not row.comparisons:
        return [pair, "", "", "", "", "", row.verdict]
    worst = max(row.comparisons, key=lambda found: abs(found.z[found.worst]) / found.limit[found.worst])
    z, limit = abs(worst.z[worst.worst]), worst.limit[worst.worst]
    first = row.comparisons[0]
    return [
        pair,
        f"{z:.1f} / {limit:.1f}",
        f"{100 * first.difference[0]:+.2f} ± {100 * first.error[0]:.2f} %",
        f"{worst.quantity}: {worst.labels[worst.worst]}",
        _finds(row.comparisons),
        ", ".join(map(_short, row.samples)),
        row.verdict,
    ]


def _finds(found: Iterable[Comparison]) -> str:
    """The least bias found in the worst sum, and in the worst block of which anything is promised."""
    found = list(found)
    of_sum = max(100 * comparison.finds[0] for comparison in found)
    blocks = [comparison.finds[1:][np.isfinite(comparison.tolerance[1:])] for comparison in found]
    of_block = max((100 * float(finds.max()) for finds in blocks if len(finds)), default=None)
    return f"{of_sum:.2f} %" if of_block is None else f"{of_sum:.2f} %, {of_block:.2f} %"


def _faults(comparison: Comparison) -> Iterator[str]:
    for at in _worst_few(comparison, comparison.differs):
        yield (
            f"{comparison.quantity}, {comparison.labels[at]}: differs by {100 * comparison.difference[at]:+.2f} ± "
            f"{100 * comparison.error[at]:.2f} %, |z| = {abs(comparison.z[at]):.1f} beyond {comparison.limit[at]:.1f}"
            f"; {int(comparison.differs.sum())} of {len(comparison.labels)} cells differ"
        )
    for at in _worst_few(comparison, comparison.underpowered):
        yield (
            f"{comparison.quantity}, {comparison.labels[at]}: a bias below {100 * comparison.finds[at]:.2f} % would not"
            f" be found, and {100 * comparison.tolerance[at]:.0f} % must; take more samples"
        )


def _worst_few(comparison: Comparison, which: Bool[ndarray, " cells"]) -> list[int]:
    order = np.argsort(-np.abs(comparison.z) / comparison.limit)
    return [int(at) for at in order if which[at]][:3]


def _short(count: int) -> str:
    return f"{count:.0e}".replace("e+0", "e").replace("e+", "e")
