"""glTF documents as trees in which each reference is replaced by what it leads to.

So two documents with other numbers for the same things, and other layouts for the same arrays, give equal trees.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from gltf_reader import DRACO, Document, scaled

Rule = Mapping[str, Any] | str | None
"""Where references lie: keys of a JSON object, each with the list that its numbers count in or with rules below it."""

EXTENSIONS: dict[str, Rule] = {
    "EXT_mesh_gpu_instancing": {"attributes": "accessors"},
    "EXT_texture_avif": {"source": "images"},
    "EXT_texture_webp": {"source": "images"},
    "KHR_animation_pointer": {"pointer": "pointer"},
    "KHR_lights_punctual": {"light": "lights"},
    "KHR_materials_variants": {"mappings": {"material": "materials", "variants": "variants"}},
    "KHR_texture_basisu": {"source": "images"},
    "KHR_xmp_json_ld": {"packet": "packets"},
    "MSFT_lod": {"ids": "nodes"},
    "MSFT_texture_dds": {"source": "images"},
    DRACO: {"bufferView": "bufferViews"},
}
MATERIAL: dict[str, Any] = {"*Texture": {"index": "textures"}}
MATERIAL["*"] = MATERIAL
PRIMITIVE = {"attributes": "accessors", "indices": "accessors", "targets": "accessors", "material": "materials"}
RULES: dict[str, Rule] = {
    "cameras": {},
    "images": {},
    "lights": {},
    "materials": MATERIAL,
    "meshes": {"primitives": PRIMITIVE},
    "nodes": {"mesh": "meshes", "skin": "skins", "camera": "cameras"},
    "samplers": {},
    "scenes": {},
    "skins": {"inverseBindMatrices": "accessors", "joints": "nodes", "skeleton": "nodes"},
    "textures": {"sampler": "samplers", "source": "images"},
}
IN_EXTENSIONS = {"lights": "KHR_lights_punctual", "variants": "KHR_materials_variants", "packets": "KHR_xmp_json_ld"}
"""Lists that lie in an extension of the root."""
KINDS = ("meshes", "skins", "cameras", "lights", "materials", "textures", "images", "samplers")
"""Lists whose items may be there without being used."""
STORAGE = ("accessors", "bufferViews", "buffers")
MAGIC = {b"\x89PNG": "image/png", b"\xff\xd8\xff": "image/jpeg", b"\xabKTX": "image/ktx2", b"RIFF": "image/webp"}


@dataclass(frozen=True, eq=False)
class Item:
    """An entry of one of the document's lists, with the references in it resolved."""

    kind: str
    index: int
    content: dict[str, Any]


@dataclass(frozen=True, eq=False)
class Resolver:
    """The items of a document that were met so far, and where each of its nodes is in the hierarchy."""

    document: Document
    places: Mapping[int, str]
    met: dict[tuple[str, int], Item] = field(default_factory=dict)

    def item(self, kind: str, index: int) -> Item:
        """The entry of a list; one object however often it is met."""
        if (kind, index) not in self.met:
            self.met[kind, index] = Item(kind, index, self._content(kind, index))
        return self.met[kind, index]

    def listed(self, kind: str) -> list[Any]:
        """The list that numbers of this kind count in."""
        if kind in IN_EXTENSIONS:
            extension: Mapping[str, Any] = self.document.json.get("extensions", {}).get(IN_EXTENSIONS[kind], {})
            return list(extension.get(kind, []))
        return self.document.items(kind)

    def walk(self, value: Any, rule: Rule) -> Any:
        """A piece of JSON with its references replaced."""
        if isinstance(value, list):
            return [self.walk(below, rule) for below in value]
        if isinstance(value, dict):
            return {key: self.walk(below, _below(rule, key)) for key, below in value.items()}
        return self._resolved(value, rule) if isinstance(rule, str) else value

    def _resolved(self, value: Any, kind: str) -> Any:
        if kind == "nodes":
            return f"node {self.places[value]}"
        if kind == "pointer":
            return self._pointed(value)
        if kind == "bufferViews":
            return self.document.view(value)
        return self.walk(self.listed(kind)[value], {}) if kind in ("variants", "packets") else self.item(kind, value)

    def _pointed(self, pointer: str) -> list[Any]:
        """The item that a JSON pointer leads to or through, and the rest of its words."""
        _, kind, number, *rest = pointer.split("/")
        if kind not in RULES:
            return [pointer]
        known = self._resolved(int(number), kind) if kind in ("nodes", "materials", "cameras", "meshes") else number
        return [known, *rest]

    def _content(self, kind: str, index: int) -> dict[str, Any]:
        value = self.listed(kind)[index]
        if kind == "accessors":
            return self._accessor(index, value)
        content: dict[str, Any] = self.walk(value, RULES[kind])
        if kind == "images":
            return self._image(content)
        if kind == "nodes" and "children" in value:
            content["children"] = [self.item("nodes", child) for child in value["children"]]
        elif kind == "scenes":
            content["nodes"] = [self.item("nodes", node) for node in value.get("nodes", [])]
        elif kind == "meshes":
            numbered = zip(content["primitives"], value["primitives"], strict=True)
            content["primitives"] = [Item("primitives", i, self._primitive(*pair)) for i, pair in enumerate(numbered)]
        return content

    def _accessor(self, index: int, accessor: Mapping[str, Any]) -> dict[str, Any]:
        content = {key: value for key, value in accessor.items() if key in ("name", "extras", "extensions")}
        if "bufferView" in accessor and self.document.is_packed(accessor["bufferView"]):
            content |= {
                key: accessor.get(key) for key in ("byteOffset", "count", "type", "componentType", "normalized")
            }
        return {**content, "values": self.document.accessor(index)}

    def _image(self, content: dict[str, Any]) -> dict[str, Any]:
        known = {key: value for key, value in content.items() if key not in ("uri", "bufferView")}
        data = self.document.resource(content["uri"]) if "uri" in content else self.document.view(content["bufferView"])
        sniffed = next((mime for magic, mime in MAGIC.items() if data.startswith(magic)), None)
        return {"mimeType": sniffed, **known, "bytes": data}

    def _primitive(self, content: dict[str, Any], value: Mapping[str, Any]) -> dict[str, Any]:
        """The primitive with arrays from its Draco data, where there is a decoder."""
        extensions = value.get("extensions", {})
        if self.document.decoders.draco is None or DRACO not in extensions:
            return content
        packing = extensions[DRACO]
        indices, values = self.document.decoders.draco(self.document.view(packing["bufferView"]), packing["attributes"])
        accessors = self.document.items("accessors")
        for name, array in values.items():
            known = accessors[value["attributes"][name]]
            content["attributes"][name] = _with_values(content["attributes"][name], scaled(array, known))
        content["indices"] = _with_values(content["indices"], indices.reshape(-1, 1))
        rest = {name: below for name, below in content["extensions"].items() if name != DRACO}
        return {
            key: value for key, value in {**content, "extensions": rest}.items() if (key, value) != ("extensions", {})
        }


def _with_values(accessor: Item, values: Any) -> Item:
    return Item(accessor.kind, accessor.index, {**accessor.content, "values": values})


def _below(rule: Rule, key: str) -> Rule:
    """The rule for a key; texture infos are known by their name's end, extensions of any object by theirs."""
    if key == "extras":
        return None
    if isinstance(rule, str):
        return rule
    known = rule or {}
    if key.endswith("Texture") and "*Texture" in known:
        return known["*Texture"]
    return known.get(key, known.get("*", EXTENSIONS if key == "extensions" else None))


def _places(document: Document) -> dict[int, str]:
    """Where each node is: its scene and the positions of its ancestors and itself among their siblings."""
    nodes = document.items("nodes")
    places: dict[int, str] = {}

    def visit(index: int, place: str) -> None:
        if index not in places:
            places[index] = place
            for position, child in enumerate(nodes[index].get("children", [])):
                visit(child, f"{place}.{position}")

    for number, scene in enumerate(document.items("scenes")):
        for position, root in enumerate(scene.get("nodes", [])):
            visit(root, f"{number}/{position}")
    for position, root in enumerate(_loose(document)):
        visit(root, f"-/{position}")
    return places


def _loose(document: Document) -> list[int]:
    """The roots that are in no scene."""
    children = {child for node in document.items("nodes") for child in node.get("children", [])}
    rooted = {root for scene in document.items("scenes") for root in scene.get("nodes", [])}
    return [index for index in range(len(document.items("nodes"))) if index not in children | rooted]


def _animation(resolver: Resolver, index: int, animation: Mapping[str, Any]) -> Item:
    """The animation with its samplers in the channels."""
    samplers = resolver.walk(animation["samplers"], {"input": "accessors", "output": "accessors"})
    channels = resolver.walk(animation["channels"], {"target": {"node": "nodes"}})
    placed = [{**channel, "sampler": samplers[channel["sampler"]]} for channel in channels]
    rest = {key: value for key, value in animation.items() if key not in ("samplers", "channels")}
    return Item("animations", index, {**rest, "channels": placed})


def tree(document: Document) -> tuple[dict[str, Any], Resolver]:
    """The whole document as a tree, with the items of which nothing in it makes use under `unused`."""
    resolver = Resolver(document, _places(document))
    root = {key: value for key, value in document.json.items() if key not in (*KINDS, *STORAGE, "nodes")}
    root["extensions"] = resolver.walk(root.get("extensions", {}), EXTENSIONS)
    root["scenes"] = [resolver.item("scenes", index) for index in range(len(document.items("scenes")))]
    root["loose"] = [resolver.item("nodes", index) for index in _loose(document)]
    root["animations"] = [_animation(resolver, *pair) for pair in enumerate(document.items("animations"))]
    root["unused"] = list(_unused(resolver))
    return root, resolver


def _unused(resolver: Resolver) -> Iterator[Item]:
    for kind in KINDS:
        for index in range(len(resolver.listed(kind))):
            if (kind, index) not in resolver.met:
                yield resolver.item(kind, index)
