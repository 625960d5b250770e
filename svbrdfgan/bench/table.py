"""Tables of figures, for the terminal and for documents."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from rich import box
from rich.markup import escape
from rich.table import Table

from svbrdfgan.bench.programs import STEPS, Figures
from svbrdfgan.bench.run import Result

LABELS = {step: step.replace("forward_backward", "forward + backward").replace("_", " ") for step in STEPS}
"""The steps in words."""
_COMPARED = ("forward", "forward_backward")


@dataclass(frozen=True)
class TextTable:
    """A table of text; an empty row separates programs."""

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def rich(self) -> Table:
        """The table without the title, which may be wider."""
        table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
        for at, name in enumerate(self.head):
            table.add_column(escape(name), justify="right" if at > 1 else "left", no_wrap=at < 3)
        for row in self.rows:
            if row:
                table.add_row(*map(escape, row))
            else:
                table.add_section()
        return table

    def markdown(self) -> str:
        ruler = ["---" if at < 2 else "---:" for at in range(len(self.head))]
        lines = [self.head, ruler, *(row for row in self.rows if row)]
        text = "".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |\n" for line in lines)
        return f"{self.title}\n\n{text}"


def case_table(result: Result) -> TextTable:
    """A table with a row for each step of each program: milliseconds, peak memory, and the others' times over it.

    The others are the peers, or where there are none the first of ours.
    """
    references = result.peers or result.backends[:1]
    head = ("", "step", "ms", "peak MiB", *(f"{other.name} / this" for other in references))
    rows: list[tuple[str, ...]] = []
    if result.embedding_s:
        rows += [("embedding", "embed, bake", milliseconds(result.embedding_s), "", *("" for _ in references)), ()]
    for figures in result.programs:
        rows += [*_steps(figures, references), ()]
    return TextTable(_title(result), head, tuple(rows[:-1]))


def axis_table(axis: str, results: Sequence[Result], centre: Result) -> TextTable:
    """Milliseconds of pictures with their gradient along one axis, rendered and stored, for each program."""
    names = dict.fromkeys(figures.name for result in results for figures in result.programs)
    rows = []
    for name in names:
        for step, kind in (("forward_backward", "fresh"), ("stored_forward_backward", "stored")):
            cells = [milliseconds(_seconds(result, name, step)) for result in results]
            if any(cells):
                rows.append((name, kind, *cells))
    head = ("forward + backward, ms", "", *(f"{along(axis, result):,}" for result in results))
    return TextTable(f"Along {axis}. Else: {_title(centre)}", head, tuple(rows))


def along(axis: str, result: Result) -> int:
    """The result's value on the axis; vertices are those of the actual scene."""
    value: int = result.vertices if axis == "vertices" else getattr(result.case, axis)
    return value


def _steps(figures: Figures, references: Sequence[Figures]) -> Iterator[tuple[str, ...]]:
    for step, seconds in figures.seconds.items():
        memory = figures.peak_bytes.get(step)
        yield (
            figures.name,
            LABELS[step],
            milliseconds(seconds),
            "" if memory is None else f"{memory / 2**20:,.0f}",
            *_ratios(step, seconds, references),
        )


def _ratios(step: str, seconds: float, references: Sequence[Figures]) -> list[str]:
    """The time of each reference for the same passes, in times of this one; empty for steps that it does not have."""
    counterpart = step.removeprefix("stored_")
    if counterpart not in _COMPARED:
        return [""] * len(references)
    return [_significant(other.seconds[counterpart] / seconds) for other in references]


def _title(result: Result) -> str:
    case = result.case
    batch = "" if case.batch == 1 else f", {case.batch} pictures at once"
    size = f"{result.vertices:,} vertices, {result.faces:,} triangles, {case.pixels}x{case.pixels} pixels"
    return f"{case.scene}: {size}, {case.spp} spp{batch}"


def _seconds(result: Result, name: str, step: str) -> float | None:
    return next((f.seconds.get(step) for f in result.programs if f.name == name), None)


def milliseconds(seconds: float | None) -> str:
    """Milliseconds as text without the unit; empty if there is no figure."""
    return "" if seconds is None else _significant(seconds * 1e3)


def _significant(value: float) -> str:
    """The number as text with at least three significant digits."""
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}" if value < 1 else f"{value:.{1 if value >= 10 else 2}f}"
