"""The page, and what is stored in it."""

from __future__ import annotations

import json
import re
from base64 import b64encode
from hashlib import sha256
from importlib.resources import files
from pathlib import Path

import pytest

from svbrdfgan.utils.display import SilentDisplay
from svbrdfgan.viewer.exhibit import Exhibit
from svbrdfgan.viewer.page import baked_page, live_page, write_page

STATIC = files("svbrdfgan.viewer") / "static"


def stored_in(page: str) -> dict[str, object]:
    found = re.search(r'<script type="application/json" id="stored">(.*?)</script>', page, re.DOTALL)
    assert found is not None
    stored: dict[str, object] = json.loads(found[1])
    return stored


def test_a_page_without_a_server_holds_all_of_its_documents(dusty: Exhibit, tmp_path: Path) -> None:
    path = tmp_path / "pages" / "van.html"
    write_page(path, dusty, SilentDisplay())
    page = path.read_text(encoding="utf-8")
    assert set(stored_in(page)) == set(dusty.paths())
    assert "<title>white &lt;van&gt;.glb</title>" in page
    assert path.stat().st_size < 8e6


def test_a_live_page_holds_nothing_but_itself() -> None:
    page = live_page("</title><script>alert(1)</script>")
    assert stored_in(page) == {}
    assert "<script>alert(1)" not in page


@pytest.mark.parametrize("kind", ["live", "baked"])
def test_pages_run_their_own_scripts_alone(dusty: Exhibit, kind: str) -> None:
    page = live_page("van") if kind == "live" else baked_page(dusty, SilentDisplay())
    policy = re.search(r'http-equiv="Content-Security-Policy" content="([^"]*)"', page)
    assert policy is not None
    told = dict(part.strip().partition(" ")[::2] for part in policy[1].split(";"))
    scripts = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    hashes = {b64encode(sha256(script.encode()).digest()).decode() for script in scripts}
    assert set(told["script-src"].split()) == {f"'sha256-{digest}'" for digest in hashes}
    assert told["default-src"] == told["base-uri"] == told["form-action"] == "'none'"
    assert told["connect-src"] == ("'self' data: blob:" if kind == "live" else "data: blob:")
    assert told["img-src"] == "data: blob:"


def test_pages_load_nothing_from_elsewhere() -> None:
    page = live_page("van")
    library = (STATIC / "three.bundle.js").read_text(encoding="utf-8")
    own = page.replace(library, "")
    assert not re.findall(r"""(?:src|href)=["'](?!data:)[^"']*["']""", own)
    assert not re.findall(r"https?://", own)
    assert page.count("</script>") == 3


def test_the_library_is_what_the_read_me_says() -> None:
    version = re.search(r"three\.js (\d+)", (STATIC / "README.md").read_text(encoding="utf-8"))
    assert version is not None
    library = (STATIC / "three.bundle.js").read_text(encoding="utf-8")
    assert f'"{version[1]}"' in library
    assert "MIT License" in (STATIC / "three.LICENSE").read_text(encoding="utf-8")
    script = (STATIC / "viewer.js").read_text(encoding="utf-8")
    entry = (STATIC / "three.entry.js").read_text(encoding="utf-8")
    taken = {name for pair in re.findall(r"^  (\w+),$|\{ (\w+) \}", entry, re.MULTILINE) for name in pair if name}
    assert set(re.findall(r"\bT\.([A-Z]\w+)", script)) == taken
