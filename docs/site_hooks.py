"""What the site adds to the pages of `docs`: links to files of the repository, and the reference of public names."""

from __future__ import annotations

import logging
import posixpath
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from make_reference import reference_pages
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

REPOSITORY = Path(__file__).parents[1]
LOG = logging.getLogger("mkdocs.hooks.site")

OVERVIEW = "api.md"
GALLERY = "gallery.md"

FENCED = re.compile(r"(^```.*?^```)", re.MULTILINE | re.DOTALL)
CELL = re.compile(r"<td\b.*?</td>", re.DOTALL)
CODE = re.compile(r"(?<=<code>)[^<]+(?=</code>)")
JOINT = re.compile(r"(?<=[/_.])(?=[a-zA-Z])")
RELATIVE = re.compile(r"(?<=\]\()(?![a-z]+:|#)([^)\s#]+)")


def address() -> str:
    """The address of the repository, as `pyproject.toml` states it."""
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return str(project["urls"]["Repository"])


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Links to the repository at the foot of each page, and lists the reference after `api.md`."""
    config.extra["social"] = [{"icon": "fontawesome/brands/github", "link": address(), "name": "Repository"}]
    _extend(config.nav, OVERVIEW, list(reference_pages()))
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds the pages of the reference."""
    for path, text in reference_pages().items():
        files.append(File.generated(config, path, content=text))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Lets links to files outside `docs` lead to the repository, and names of the API to their reference."""

    def replaced(link: re.Match[str]) -> str:
        target = posixpath.normpath(posixpath.join("docs", posixpath.dirname(page.file.src_uri), link[1]))
        return link[1] if target.startswith("docs/") else in_repository(target, warn)

    def warn(target: str) -> None:
        LOG.warning("%s links to %s, which does not exist; name a file of the repository", page.file.src_uri, target)

    if page.is_homepage or page.file.src_uri == GALLERY:
        page.meta["hide"] = ["navigation"]  # a menu of one page
    if page.file.src_uri == OVERVIEW:
        markdown = re.sub(r"^\| `(\w+)` \|", r"| [`\1`][svbrdfgan.\1] |", markdown, flags=re.MULTILINE)
    parts = FENCED.split(markdown)
    parts[::2] = [RELATIVE.sub(replaced, part) for part in parts[::2]]
    return "".join(parts)


def on_post_page(output: str, page: Page, config: MkDocsConfig) -> str:
    """Lets paths and names in cells of tables break only where they are joined, and keeps errors beside figures."""

    def whole(cell: re.Match[str]) -> str:
        return CODE.sub(lambda code: JOINT.sub("<wbr>", code[0]), cell[0]).replace(" ± ", "&nbsp;±&nbsp;")

    return CELL.sub(whole, output)


def in_repository(target: str, warn: Callable[[str], None]) -> str:
    """The address of a file or folder of the repository."""
    path = REPOSITORY / target
    if not path.exists():
        warn(target)
    return f"{address()}/{'tree' if path.is_dir() else 'blob'}/HEAD/{target}"


def _extend(items: Any, page: str, more: list[str]) -> None:
    """Puts pages at the end of the list in which one is."""
    for item in items if isinstance(items, list) else ():
        for value in item.values() if isinstance(item, dict) else ():
            _extend(value, page, more)
    if isinstance(items, list) and any(page in (item.values() if isinstance(item, dict) else [item]) for item in items):
        items += more
