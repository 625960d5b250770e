"""The page of a viewer: one HTML document, with the library, and without a server with all that it shows."""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Mapping
from hashlib import sha256
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

from svbrdfgan.io.atomic import atomic_path
from svbrdfgan.utils.display import Display
from svbrdfgan.viewer.documents import JSON, Document

if TYPE_CHECKING:
    from svbrdfgan.viewer.exhibit import Exhibit

_STATIC = files("svbrdfgan.viewer") / "static"
_LIBRARY, _SCRIPT = "three.bundle.js", "viewer.js"


def live_page(title: str) -> str:
    """The page that asks a server for what it shows."""
    return _page(title, {}, live_policy())


def live_policy() -> str:
    """The content security policy of the page that asks a server: its own two scripts, and nothing from elsewhere."""
    return _policy("'self' ")


def write_page(path: Path, exhibit: Exhibit, display: Display) -> None:
    """Writes the page that works without a server.

    Raises:
        AssetError: the file cannot be written, or nothing weathers.
        SvbrdfganError: something cannot be painted.
    """
    page = baked_page(exhibit, display)
    with atomic_path(path) as temporary:
        temporary.write_text(page, encoding="utf-8")


def baked_page(exhibit: Exhibit, display: Display) -> str:
    """The page that works without a server: all that its sliders show is painted now.

    Raises:
        AssetError: nothing weathers.
        SvbrdfganError: something cannot be painted.
    """
    paths = list(exhibit.paths())
    display.begin("painting", len(paths))
    stored = {}
    for each in paths:
        stored[each] = exhibit.document(each)
        display.advance()
    return _page(exhibit.title, stored, _policy())


def _page(title: str, stored: Mapping[str, Document], policy: str) -> str:
    content = {path: _plain(document) for path, document in stored.items()}
    parts = {
        "POLICY": policy,
        "TITLE": escape(title),
        "STYLE": _read("viewer.css"),
        "STORED": json.dumps(content).replace("<", "\\u003c"),
        "LIBRARY": _read(_LIBRARY),
        "SCRIPT": _read(_SCRIPT),
    }
    page = _read("page.html")
    for name, text in parts.items():
        head, mark, tail = page.partition(f"<!--{name}-->")
        assert mark, name
        page = head + text + tail
    return page


def _policy(server: str = "") -> str:
    hashes = [b64encode(sha256(_read(name).encode()).digest()).decode() for name in (_LIBRARY, _SCRIPT)]
    scripts = " ".join(f"'sha256-{digest}'" for digest in hashes)
    return (
        f"default-src 'none'; script-src {scripts}; style-src 'unsafe-inline'; connect-src {server}data: blob:; "
        "img-src data: blob:; worker-src blob:; base-uri 'none'; form-action 'none'"
    )


def _plain(document: Document) -> object:
    return json.loads(document.data) if document.kind == JSON else b64encode(document.data).decode()


def _read(name: str) -> str:
    return (_STATIC / name).read_text(encoding="utf-8")
