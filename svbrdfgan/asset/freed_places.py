"""New textures in the places of those that they replace, so that a file keeps no picture that nothing shows."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from svbrdfgan.io.gltf.document import Document, Json, drop_views, named_views

_SOURCE = "source"


def take_freed_places(document: Document, before: Document) -> None:
    """Moves textures and images that were added to the places of those that nothing names any more.

    What was unused in the first place stays. So do an image's name and extras, under its new picture.
    """
    seen = named_views(document.header)
    for name, key in (("textures", "index"), ("images", _SOURCE)):
        _move_last(document, before, name, key)
    drop_views(document, seen - named_views(document.header))


def _move_last(document: Document, before: Document, name: str, key: str) -> None:
    references = list(_references(document.header, key))
    used = {reference[key] for reference in references}
    freed = sorted({reference[key] for reference in _references(before.header, key)} - used)
    entries = document.table(name)
    for place in freed:
        if len(entries) == len(before.table(name)):
            return
        last = entries.pop()
        kept = {k: v for k, v in entries[place].items() if k in ("name", "extras")}
        entries[place] = {**kept, **last}
        for reference in references:
            if reference[key] == len(entries):
                reference[key] = place


def _references(header: Json, key: str) -> Iterator[Json]:
    """The tables that name a texture by `index`, or an image by `source`."""
    yield from _tables(header.get("textures" if key == _SOURCE else "materials", []), key, inside=key == _SOURCE)


def _tables(entry: Any, key: str, *, inside: bool) -> Iterator[Json]:
    """The dictionaries with an integer under the key, if they are under a key that ends in Texture, or `inside`."""
    if isinstance(entry, dict):
        if inside and isinstance(entry.get(key), int):
            yield entry
        for name, value in entry.items():
            if name != "extras":
                yield from _tables(value, key, inside=key == _SOURCE or name.endswith("Texture"))
    elif isinstance(entry, list):
        for value in entry:
            yield from _tables(value, key, inside=inside)
