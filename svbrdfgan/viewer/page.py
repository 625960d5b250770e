"""The page of a viewer: one HTML document, with the library, and without a server with all that it shows."""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Mapping
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


def live_page(title: str) -> str:
    """The page that asks a server for what it shows."""
    return _page(title, {})


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
    return _page(exhibit.title, stored)


def _page(title: str, stored: Mapping[str, Document]) -> str:
    content = {path: _plain(document) for path, document in stored.items()}
    parts = {
        "TITLE": escape(title),
        "STYLE": _read("viewer.css"),
        "STORED": json.dumps(content).replace("</", "<\\/"),
        "LIBRARY": _read("three.bundle.js"),
        "SCRIPT": _read("viewer.js"),
    }
    page = _read("page.html")
    for name, text in parts.items():
        head, mark, tail = page.partition(f"<!--{name}-->")
        assert mark, name
        page = head + text + tail
    return page


def _plain(document: Document) -> object:
    return json.loads(document.data) if document.kind == JSON else b64encode(document.data).decode()


def _read(name: str) -> str:
    return (_STATIC / name).read_text(encoding="utf-8")
