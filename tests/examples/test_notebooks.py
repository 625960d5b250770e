"""The notebooks of `examples/notebooks` run, and are stored as they ran: with pictures, and no path of a machine."""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import nbformat
import numpy as np
import pytest
from nbclient import NotebookClient
from nbformat import NotebookNode
from nbformat.v4 import new_code_cell, new_notebook, new_output
from PIL import Image

FOLDER = Path(__file__).parents[2] / "examples" / "notebooks"
NAMES = ("artist", "researcher")
PICTURES = {"artist": 5, "researcher": 6}
"""How many cells of each notebook show a picture."""
MOST_BYTES = 600_000
LEAST_SIZE = (400, 140)
MACHINE = re.compile(r"(?:/work|/tmp|/root|/home|/Users|site-packages)\b|[A-Z]:\\")
SECONDS = 300
"""For one cell, on busy cores."""


def stored(name: str) -> NotebookNode:
    return nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)


def code_cells(notebook: NotebookNode) -> list[NotebookNode]:
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def kinds(cell: NotebookNode) -> list[str]:
    """What a cell shows besides notices: words without their numbers, and pictures by type."""
    shown = [output for output in cell.outputs if output.get("name") != "stderr"]
    return [picture_type(output) or " ".join(re.sub(r"[-\d.]+", "", text(output)).split()) for output in shown]


def picture_type(output: NotebookNode) -> str | None:
    return next((kind for kind in output.get("data", {}) if kind.startswith("image/")), None)


def pictures(notebook: NotebookNode) -> Iterator[np.ndarray[Any, Any]]:
    for cell in code_cells(notebook):
        for output in cell.outputs:
            if kind := picture_type(output):
                data = base64.b64decode(output.data[kind])
                yield np.asarray(Image.open(io.BytesIO(data)).convert("RGB"), dtype=np.float64)


def text(output: NotebookNode) -> str:
    """What a reader sees of an output besides its picture."""
    return "\n".join([output.get("text", ""), str(output.get("data", {}).get("text/plain", ""))])


def faults(notebook: NotebookNode) -> list[str]:
    """What is wrong with the outputs of a notebook that ran."""
    found = []
    for number, cell in enumerate(code_cells(notebook), 1):
        if cell.execution_count != number:
            found.append(f"cell {number} ran as number {cell.execution_count}")
        for output in cell.outputs:
            if output.output_type == "error" or output.get("name") == "stderr":
                found.append(f"cell {number} has an error or a warning")
            if MACHINE.search(text(output)) or re.search(r"warning\b", text(output), re.IGNORECASE):
                found.append(f"cell {number} shows a path or a warning: {text(output)}")
        shows = re.search(r"^(?:print|display|show|plt\.show|Image)\(|^    print\(", cell.source, re.MULTILINE)
        if shows and not cell.outputs:
            found.append(f"cell {number} shows nothing")
    for number, picture in enumerate(pictures(notebook), 1):
        height, width = picture.shape[:2]
        if width < LEAST_SIZE[0] or height < LEAST_SIZE[1]:
            found.append(f"picture {number} has {width} x {height} pixels")
        if picture.std(axis=(0, 1)).max() < 10:
            found.append(f"picture {number} is of one colour")
    return found


@pytest.mark.parametrize("name", NAMES)
def test_stored_as_it_ran(name: str) -> None:
    notebook = stored(name)
    nbformat.validate(notebook)
    assert faults(notebook) == []
    assert sum(1 for _ in pictures(notebook)) == PICTURES[name]
    assert (FOLDER / f"{name}.ipynb").stat().st_size <= MOST_BYTES


@pytest.mark.parametrize("name", NAMES)
def test_lines_of_text_are_short_and_links_have_targets(name: str) -> None:
    for cell in stored(name).cells:
        if cell.cell_type == "markdown":
            assert max(map(len, cell.source.splitlines())) <= 150
            for link in re.findall(r"\]\(([^)#]+)", cell.source):
                assert (FOLDER / link).exists(), link


@pytest.mark.full
@pytest.mark.parametrize("name", NAMES)
def test_runs_again(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for key, value in {
        "GOMP_SPINCOUNT": "3000",
        "IPYTHONDIR": str(tmp_path / "ipython"),
        "JUPYTER_RUNTIME_DIR": str(tmp_path / "runtime"),
    }.items():
        monkeypatch.setenv(key, value)
    before, notebook = stored(name), stored(name)
    for cell in code_cells(notebook):
        cell.outputs, cell.execution_count = [], None
    place = {"metadata": {"path": str(tmp_path)}}
    NotebookClient(notebook, timeout=SECONDS, kernel_name="python3", resources=place).execute()
    assert [cell.source for cell in code_cells(notebook)] == [cell.source for cell in code_cells(before)]
    assert [kinds(cell) for cell in code_cells(notebook)] == [kinds(cell) for cell in code_cells(before)]
    assert sum(1 for _ in pictures(notebook)) == PICTURES[name]
    assert [fault for fault in faults(notebook) if "warning" not in fault] == []  # a machine may have its own


def grey(width: int, height: int) -> NotebookNode:
    data = io.BytesIO()
    Image.new("RGB", (width, height), (90, 90, 90)).save(data, "PNG")
    return new_output("display_data", {"image/png": base64.b64encode(data.getvalue()).decode()})


@pytest.mark.parametrize(
    ("source", "outputs"),
    [
        ("print(1)", []),
        ("1", [new_output("stream", name="stderr", text="a line")]),
        ("1", [new_output("stream", text="written to /tmp/a")]),
        ("1", [new_output("stream", text="UserWarning: old")]),
        ("1", [new_output("execute_result", {"text/plain": "PosixPath('/home/a')"})]),
        ("1", [grey(800, 450)]),
    ],
)
def test_faults_are_found(source: str, outputs: list[NotebookNode]) -> None:
    assert faults(new_notebook(cells=[new_code_cell("1", execution_count=1)])) == []
    assert len(faults(new_notebook(cells=[new_code_cell(source, outputs=outputs, execution_count=1)]))) == 1
