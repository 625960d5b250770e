"""Two glTF documents compared node by node, with the permission to differ in what weathering changes."""

import zlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from gltf_reader import DRACO, Document
from jaxtyping import Shaped
from numpy import ndarray
from permissions import COMPRESSIONS, NOTHING, Allowed, Change, by_corner, extensions_in, left_of_material
from references import Item, Resolver, tree

COUNTED = ("meshes", "materials", "textures", "images", "samplers", "skins", "cameras")
WORDS = {"meshes": "mesh", "indices": "indices"}
NEVER_COMPARED = ("unused", "extensionsUsed", "extensionsRequired", "asset")


def differences(before: Document, after: Document, allowed: Allowed = NOTHING) -> list[str]:
    """One sentence for each place where the second document is not what the first one was, or may become.

    Numbers of things, the layout of buffers, and how files are split do not count. The order of scenes, nodes,
    primitives, morph targets, channels and of an extension's lists does. Shared things are compared once.
    """
    first, known = tree(before)
    second, found = tree(after)
    comparison = Comparison(allowed)
    return [
        *comparison.asset(first["asset"], second["asset"]),
        *_extension_names(first, second, allowed, (known, found)),
        *comparison.compare(_without(first, NEVER_COMPARED), _without(second, NEVER_COMPARED), ""),
        *_lost(first["unused"], found, allowed),
        *_counts(known, found, allowed.what),
    ]


@dataclass(frozen=True)
class Comparison:
    """A comparison under way: what is allowed, and which pairs of items were compared."""

    allowed: Allowed
    done: set[tuple[Item, Item]] = field(default_factory=set)

    def compare(self, before: Any, after: Any, where: str) -> Iterator[str]:
        """The differences below one place of the two trees."""
        if isinstance(before, Item) and isinstance(after, Item):
            yield from self._items(before, after, where)
        elif isinstance(before, dict) and isinstance(after, dict):
            yield from self._dicts(before, after, where)
        elif isinstance(before, list) and isinstance(after, list):
            yield from self._lists(before, after, where)
        elif isinstance(before, ndarray) and isinstance(after, ndarray):
            yield from _arrays(before, after, where)
        elif before != after or (type(before) is bool) != (type(after) is bool):
            yield f"{where}: was {_shown(before)}, is {_shown(after)}."

    def asset(self, before: Mapping[str, Any], after: Mapping[str, Any]) -> Iterator[str]:
        """The differences in `asset`, of which the generator and further extras may be allowed."""
        if Change.STAMP not in self.allowed.what:
            yield from self.compare(before, after, "asset")
            return
        extras, kept = before.get("extras", {}), after.get("extras", {})
        if isinstance(extras, dict) and isinstance(kept, dict):
            kept = {key: value for key, value in kept.items() if key in extras}
        free = ("generator", "extras")
        yield from self.compare(_without(before, free), _without(after, free), "asset")
        yield from self.compare(extras, kept, "asset > extras")

    def _items(self, before: Item, after: Item, where: str) -> Iterator[str]:
        if (before, after) in self.done:
            return
        self.done.add((before, after))
        where = _joined(where, _title(before))
        yield from self.compare(*self._contents(before, after), where)

    def _contents(self, before: Item, after: Item) -> tuple[dict[str, Any], dict[str, Any]]:
        """What is to be compared of two items, after what may differ."""
        first, second, what = before.content, after.content, self.allowed.what
        if before.kind == "materials" and self.allowed.material(before):
            return self._renamed(left_of_material(first, what), left_of_material(second, what))
        if before.kind == "meshes" and self.allowed.carrier(before):
            return self._renamed(first, second)
        if before.kind == "primitives" and Change.UV_SETS in what and self.allowed.carrier(before):
            if "material" not in first and self.allowed.material(None):
                second = _without(second, ("material",))
            if Change.COLORS in what and "COLOR_0" not in second["attributes"]:
                first = {**first, "attributes": _without(first["attributes"], ("COLOR_0",))}
            return (by_corner(first, first), by_corner(second, first)) if _readable(first, second) else (first, second)
        return first, second

    def _renamed(self, before: dict[str, Any], after: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
        """The two without the names, if the second is that of a copy."""
        is_copy = str(after.get("name", "")).startswith(str(before.get("name", "")))
        if Change.COPIES in self.allowed.what and is_copy:
            return _without(before, ("name",)), _without(after, ("name",))
        return before, after

    def _dicts(self, before: Mapping[str, Any], after: Mapping[str, Any], where: str) -> Iterator[str]:
        for key in before:
            if key not in after:
                yield f"{_joined(where, key)}: is gone; it was {_shown(before[key])}."
            else:
                yield from self.compare(before[key], after[key], _joined(where, key))
        yield from (f"{_joined(where, key)}: is new: {_shown(after[key])}." for key in after if key not in before)

    def _lists(self, before: list[Any], after: list[Any], where: str) -> Iterator[str]:
        if len(before) != len(after):
            yield f"{where}: were {len(before)} ({_names(before)}), are {len(after)} ({_names(after)})."
            return
        for index, pair in enumerate(zip(before, after, strict=True)):
            yield from self.compare(*pair, where if isinstance(pair[0], Item) else f"{where}[{index}]")


def _arrays(before: Shaped[ndarray, "..."], after: Shaped[ndarray, "..."], where: str) -> Iterator[str]:
    if before.shape != after.shape:
        yield f"{where}: had {_shown(before)}, has {_shown(after)}."
        return
    rows = np.flatnonzero(((before != after) & ~((before != before) & (after != after))).any(axis=1))
    if len(rows):
        first = rows[0]
        change = f"row {first} was {before[first].tolist()}, is {after[first].tolist()}"
        yield f"{where}: differs in {len(rows)} of {len(before)} rows; {change}."


def _lost(unused: list[Item], found: Resolver, allowed: Allowed) -> Iterator[str]:
    """The unused items of the original of which no item of the other document is the like."""
    for item in unused:
        others = (found.item(item.kind, index) for index in range(len(found.listed(item.kind))))
        if all(any(Comparison(allowed).compare(item, other, "")) for other in others):
            yield f"{_title(item)}: is gone or changed; nothing used it."


def _counts(known: Resolver, found: Resolver, what: Change) -> Iterator[str]:
    """Lists with another number of items than before, of those where no copy or new texture was allowed."""
    free = {"meshes", "materials"} if Change.COPIES in what else set()
    free |= {"textures", "images", "samplers"} if Change.TEXTURES in what else set()
    for kind in COUNTED:
        before, after = len(known.listed(kind)), len(found.listed(kind))
        if before != after and kind not in free:
            yield f"{kind}: were {before}, are {after}."


def _extension_names(
    before: Mapping[str, Any], after: Mapping[str, Any], allowed: Allowed, resolvers: tuple[Resolver, Resolver]
) -> Iterator[str]:
    """Changes in `extensionsUsed` and `extensionsRequired` beyond those that allowed changes bring with them.

    Names that allowed materials had may go if nothing has them any more; those that the new materials have may come.
    """
    lost, new = (
        set(extensions_in([item for item in resolver.met.values() if item.kind in ("materials", "textures")]))
        for resolver in resolvers
    )
    changes = bool(allowed.what & (Change.TEXTURES | Change.FACTORS)) and bool(allowed.materials)
    may_go = (lost - new if changes else set()) | (COMPRESSIONS if Change.DECOMPRESSION in allowed.what else set())
    may_come = new - lost if changes else set()
    for key in ("extensionsUsed", "extensionsRequired"):
        first, second = set(before.get(key, ())), set(after.get(key, ()))
        yield from (f"{key}: {name} is gone." for name in sorted(first - second - may_go))
        yield from (f"{key}: {name} is new." for name in sorted(second - first - may_come))


def _readable(*primitives: Mapping[str, Any]) -> bool:
    """Whether all arrays of the primitives could be decoded, and no index points beyond them."""
    return not any(
        DRACO in primitive.get("extensions", {})
        or any("componentType" in item.content for item in primitive["attributes"].values())
        or _last_index(primitive) >= min(len(item.content["values"]) for item in primitive["attributes"].values())
        for primitive in primitives
    )


def _last_index(primitive: Mapping[str, Any]) -> int:
    return int(primitive["indices"].content["values"].max(initial=0)) if "indices" in primitive else 0


def _without(content: Mapping[str, Any], keys: Iterable[str]) -> dict[str, Any]:
    return {key: value for key, value in content.items() if key not in keys}


def _joined(where: str, below: str) -> str:
    return f"{where} > {below}" if where else below


def _title(item: Item) -> str:
    name = item.content.get("name")
    return f"{WORDS.get(item.kind, item.kind[:-1])} {item.index}" + (f" {name!r}" if name is not None else "")


def _names(values: list[Any]) -> str:
    return ", ".join(_title(value) if isinstance(value, Item) else _shown(value) for value in values[:4]) or "none"


def _shown(value: Any) -> str:
    if isinstance(value, Item):
        return _title(value)
    if isinstance(value, ndarray):
        return f"{len(value)} rows of {value.shape[1]} numbers"
    if isinstance(value, bytes):
        return f"{len(value)} bytes with CRC {zlib.crc32(value):08x}"
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
