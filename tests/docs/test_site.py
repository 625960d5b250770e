"""The site of docs/ has every public name, leads to the repository's files, and loads nothing from other hosts."""

import os
import re
import subprocess
import sys
from collections import Counter
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

EXPLAINED = re.compile(r"^::: ([\w.]+)$", re.MULTILINE)
ELSEWHERE = re.compile(r"\[`([\w.]+)`\]\[([\w.]+)\]")


@pytest.fixture
def reference(repository: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(str(repository / "docs"))
    return __import__("make_reference")


@pytest.fixture
def hooks(repository: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(str(repository / "docs"))
    return __import__("site_hooks")


class Loaded(HTMLParser):
    """What a browser loads to show a page: all but the targets of links."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.addresses: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag != "a":
            self.addresses += [value for name, value in attrs if name in ("src", "srcset", "href", "data") and value]


def foreign(page: str) -> list[str]:
    return [address for address in Loaded(page).addresses if re.match(r"(\w+:)?//", address)]


def test_the_reference_has_every_public_name_once(reference: Any, repository: Path) -> None:
    text = "\n".join(reference.reference_pages().values())
    explained, elsewhere = EXPLAINED.findall(text), dict(ELSEWHERE.findall(text))
    wanted = (repository / "tests" / "public_names.txt").read_text(encoding="utf-8").split()
    assert Counter([*explained, *elsewhere]) == Counter(wanted)
    assert set(elsewhere.values()) <= set(explained)


def test_a_name_that_is_new_is_in_the_reference(reference: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    names = [*reference.public_names(), "svbrdfgan.geometry.cells.fresh"]
    monkeypatch.setattr(reference, "public_names", lambda: names)
    assert "\n::: svbrdfgan.geometry.cells.fresh\n" in reference.reference_pages()["api/for-plugins.md"]


def test_links_lead_out_of_the_docs_to_the_repository(hooks: Any, caplog: pytest.LogCaptureFixture) -> None:
    page = SimpleNamespace(file=SimpleNamespace(src_uri="lab/page.md"), is_homepage=False)
    inside = "[a](../concepts.md#x) ![b](../b.png) [c](#d) [e](https://x.org)\n```sh\n[f](../../README.md)\n```\n"
    assert hooks.on_page_markdown(inside, page, None, None) == inside
    told = hooks.on_page_markdown("[a](../../README.md#install) [b](../../examples)", page, None, None)
    assert told == f"[a]({hooks.address()}/blob/HEAD/README.md#install) [b]({hooks.address()}/tree/HEAD/examples)"
    assert not caplog.records
    hooks.on_page_markdown("[a](../../gone.md)", page, None, None)
    assert "gone.md, which does not exist" in caplog.text


def test_names_of_the_overview_lead_to_their_reference(hooks: Any) -> None:
    page = SimpleNamespace(file=SimpleNamespace(src_uri="api.md"), is_homepage=False)
    assert hooks.on_page_markdown("| `Mesh` | x |", page, None, None) == "| [`Mesh`][svbrdfgan.Mesh] | x |"


def test_names_in_tables_break_where_they_are_joined(hooks: Any) -> None:
    page = "<code>a/b</code><td><code>docs/a_b.py</code> and/or <code>0.5</code> ± 1</td>"
    broken = "<code>a/b</code><td><code>docs/<wbr>a_<wbr>b.<wbr>py</code> and/or <code>0.5</code>&nbsp;±&nbsp;1</td>"
    assert hooks.on_post_page(page, None, None) == broken


def test_foreign_files_are_found() -> None:
    page = '<a href="https://x.org"></a><link href="//y.org/a.css"><script src="https://z.org"></script><img src="b">'
    assert foreign(page) == ["//y.org/a.css", "https://z.org"]


@pytest.mark.full
def test_the_site_is_complete_and_loads_nothing_from_elsewhere(repository: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path)]
    subprocess.run(command, cwd=repository, env={**os.environ, "NO_MKDOCS_2_WARNING": "1"}, check=True)
    pages = {path: path.read_text(encoding="utf-8") for path in tmp_path.rglob("*.html")}
    text = "".join(pages.values())
    for name in (repository / "tests" / "public_names.txt").read_text(encoding="utf-8").split():
        assert f'id="{name}"' in text or f"<code>{name}</code></a>" in text
    assert {path.name: found for path, page in pages.items() if (found := foreign(page))} == {}
    for path in tmp_path.rglob("*.css"):
        assert not re.search(r"(url\(|@import )[\"']?(https?:)?//", path.read_text(encoding="utf-8"))
