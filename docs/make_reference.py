"""Makes the reference of every public name for the site: Markdown in which mkdocstrings replaces each line of `:::`."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

REPOSITORY = Path(__file__).parents[1]
FOLDER = "api"

SECTION_OF = {"svbrdfgan.types": "Records", "svbrdfgan.errors": "Errors and version"}
"""The section of `api.md` that has the names of a module; those of any other module are under `FOR_PLUGINS`."""

FOR_PLUGINS = "For plugins"


def public_names() -> list[str]:
    """Every public name with its module, such as `svbrdfgan.types.Mesh`."""
    return (REPOSITORY / "tests" / "public_names.txt").read_text(encoding="utf-8").split()


def sections() -> dict[str, list[str]]:
    """The headings of `api.md`, and the package's names below each."""
    parts = re.split(r"^## +(.*)\n", (REPOSITORY / "docs" / "api.md").read_text(encoding="utf-8"), flags=re.MULTILINE)
    found = {
        heading: re.findall(r"^\| `(\w+)` \|", text, re.MULTILINE)
        for heading, text in zip(parts[1::2], parts[2::2], strict=True)
    }
    return {heading: names for heading, names in found.items() if names}


def plugin_modules() -> dict[str, list[str]]:
    """The modules that plugins import from, and the names in each."""
    found: dict[str, list[str]] = {}
    for module, _, name in (public.rpartition(".") for public in public_names()):
        if module != "svbrdfgan":
            found.setdefault(module, []).append(name)
    return found


def reference_pages() -> dict[str, str]:
    """The pages by their paths in `docs`: one for each section of `api.md`, in that order."""
    return {
        f"{FOLDER}/{heading.lower().replace(' ', '-')}.md": "\n\n".join([f"# {heading}", *_page(heading, names)]) + "\n"
        for heading, names in sections().items()
    }


def _page(heading: str, names: list[str]) -> Iterator[str]:
    yield from (f"::: svbrdfgan.{name}" for name in names)
    of_package = {name for listed in sections().values() for name in listed}
    for module, members in plugin_modules().items():
        if SECTION_OF.get(module, FOR_PLUGINS) == heading:
            yield f"## {module}"
            if shared := [f"[`{module}.{name}`][svbrdfgan.{name}]" for name in members if name in of_package]:
                yield f"Plugins import from here what is explained under the package: {', '.join(shared)}."
            for name in members:
                if name not in of_package:
                    yield f"::: {module}.{name}\n    options:\n      heading_level: 3"
