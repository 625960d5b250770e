"""Reports and viewer pages show names that strangers gave, and no element and no attribute comes of them."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from html import escape
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import pytest

from svbrdfgan.data.config import DatasetConfig, MeshSource, SplitConfig
from svbrdfgan.io.gltf.document import read_document, write_document
from svbrdfgan.report.page import write_report
from svbrdfgan.utils.display import SilentDisplay
from svbrdfgan.viewer.documents import Document
from svbrdfgan.viewer.open import exhibit_of
from svbrdfgan.viewer.page import baked_page, live_page

if TYPE_CHECKING:
    from svbrdfgan.viewer.exhibit import Exhibit

pytest.importorskip("xatlas")

NAMES = (
    "<script>alert(1)</script>",
    '"><img src=x onerror=alert(1)>',
    "' onmouseover='alert(1)",
    "javascript:alert(1)",
    "</script><script>alert(1)</script>",
    "<!--<script>",
    "--><!--STORED--><!--LIBRARY--><!--SCRIPT-->",
    "</title></style></pre></iframe><svg onload=alert(1)>",
    "{{ 7 * 7 }}{% raw %}${7 * 7}",
    "&lt;b&gt; & &#60;b>",
    "two\nlines\r\n\x1b[31m\u202egpj\u2066\u2028",
)
FILE_NAMES = tuple(name.replace("/", "") for name in NAMES)


class Skeleton(HTMLParser):
    """A page without its words: each element with the names of its attributes, and all that would be followed."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, ...]] = []
        self.addresses: list[str] = []
        self.inner = ""
        self.scripts: list[str] = []
        self.feed(page)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, *(name for name, _ in attrs)))
        self.addresses += [value or "" for name, value in attrs if name in ("src", "href", "xlink:href", "action")]
        self.inner = dict(attrs).get("srcdoc") or self.inner

    def handle_data(self, data: str) -> None:
        if self.lasttag == "script" and data.strip():
            self.scripts.append(data)


@pytest.fixture(scope="module")
def viewer_page(van: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The page of a van whose file, nodes, meshes and materials are named by a stranger."""
    document = read_document(van)
    for table in ("nodes", "meshes", "materials"):
        for number, entry in enumerate(document.table(table)):
            entry["name"] = NAMES[number % len(NAMES)]
    path = tmp_path_factory.mktemp("hostile") / f"{''.join(FILE_NAMES[:7])}.glb"
    write_document(path, document)
    exhibit = exhibit_of(path, recipe="dust", learnable=["*"], fine=512, baked=((0,), (1.0,)))
    return baked_page(exhibit, SilentDisplay())


@dataclass(frozen=True)
class Words:
    """Shows nothing but names."""

    title: str

    def paths(self) -> list[str]:
        return [*NAMES, "/state"]

    def document(self, path: str) -> Document:
        return Document.of({"title": self.title, "pieces": [{"name": name} for name in NAMES]})


def stored_in_usual_page(page: str) -> dict[str, Any]:
    """What is stored in a viewer's page, after a check that all of it but words is as in any other."""
    usual, found = Skeleton(live_page("van")), Skeleton(page)
    assert found.elements == usual.elements
    assert found.addresses == ["data:,"]
    assert found.scripts[1:] == usual.scripts[1:]
    assert "<" not in found.scripts[0]  # of `<!--<script>` browsers make more than `</script>` ends
    stored: dict[str, Any] = json.loads(found.scripts[0])
    return stored


def test_a_page_of_names_has_the_elements_of_any_other() -> None:
    title = "".join(NAMES)
    stored = stored_in_usual_page(baked_page(cast("Exhibit", Words(title)), SilentDisplay()))
    assert stored["/state"] == {"title": title, "pieces": [{"name": name} for name in NAMES]}
    assert set(stored) == {*NAMES, "/state"}


@pytest.mark.full
def test_a_viewer_page_has_the_elements_of_any_other(viewer_page: str) -> None:
    assert stored_in_usual_page(viewer_page)["/state"]["title"].startswith(FILE_NAMES[0])


def made_report(run: Path, makers: SimpleNamespace, names: tuple[str, ...], words: tuple[str, ...], live: str) -> str:
    """The report of a run on meshes, of a data set and of versions of these names."""
    run.mkdir(parents=True)
    evaluated = makers.make_evaluated(names=names)
    config = evaluated.config
    dataset = DatasetConfig(
        splits={"train": SplitConfig(meshes=MeshSource(files=tuple(f"{word}.glb" for word in words)))}
    )
    train = config.train.model_copy(update={"dataset": "".join(words)})
    versions = dict(zip(words, reversed(words), strict=True))
    config = config.model_copy(update={"dataset": dataset, "train": train, "versions": versions})
    return write_report(run, replace(evaluated, config=config), live).read_text(encoding="utf-8")


@pytest.mark.full
def test_a_report_has_the_elements_of_any_other(tmp_path: Path, makers: SimpleNamespace, viewer_page: str) -> None:
    plain = tuple(f"name{number}" for number in range(len(NAMES)))
    usual = Skeleton(made_report(tmp_path / "usual" / "run", makers, plain, plain, live_page("van")))
    run = tmp_path / "".join(FILE_NAMES[:7])
    page = made_report(run, makers, FILE_NAMES, NAMES, viewer_page)
    hostile = Skeleton(page)
    assert hostile.elements == usual.elements
    assert {address.split(",")[0] for address in hostile.addresses} == {"data:image/png;base64"}
    assert hostile.scripts == usual.scripts
    assert hostile.inner == viewer_page
    assert escape("<script>alert(1)<script>", quote=False) in page
