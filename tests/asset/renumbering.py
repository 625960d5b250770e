"""The sample document with all its lists in reverse, and every reference in it counted anew, place by place."""

from typing import Any

from sample_document import Pieces


def renumbered(pieces: Pieces) -> Pieces:
    """The document with another number for everything, and the same meaning."""
    last = {kind: len(pieces[kind]) - 1 for kind in KINDS}
    for kind, holder, key in _places(pieces):
        numbers = holder[key]
        holder[key] = [last[kind] - n for n in numbers] if isinstance(numbers, list) else last[kind] - numbers
    for kind in KINDS:
        pieces[kind].reverse()
    pointed = pieces["animations"][0]["channels"][1]["target"]["extensions"]["KHR_animation_pointer"]
    pointed["pointer"] = pointed["pointer"].replace("/materials/0/", f"/materials/{last['materials']}/")
    return pieces


KINDS = ("nodes", "meshes", "materials", "textures", "samplers", "images", "cameras", "skins", "accessors")


def _places(pieces: Pieces) -> list[tuple[str, Any, Any]]:
    """The kind of each reference, with the object that holds it and its key there."""
    places = [("nodes", pieces["scenes"][0], "nodes")]
    for node in pieces["nodes"]:
        keys = {"children": "nodes", "mesh": "meshes", "camera": "cameras", "skin": "skins"}
        places += [(kind, node, key) for key, kind in keys.items() if key in node]
        attributes = node.get("extensions", {}).get("EXT_mesh_gpu_instancing", {}).get("attributes", {})
        places += [("accessors", attributes, name) for name in attributes]
    for skin in pieces["skins"]:
        places += [("nodes", skin, "joints"), ("nodes", skin, "skeleton"), ("accessors", skin, "inverseBindMatrices")]
    for animation in pieces["animations"]:
        places += [("accessors", sampler, key) for sampler in animation["samplers"] for key in ("input", "output")]
        targets = [channel["target"] for channel in animation["channels"]]
        places += [("nodes", target, "node") for target in targets if "node" in target]
    return [*places, *_of_meshes(pieces), *_of_textures(pieces)]


def _of_meshes(pieces: Pieces) -> list[tuple[str, Any, Any]]:
    places: list[tuple[str, Any, Any]] = []
    for primitive in (primitive for mesh in pieces["meshes"] for primitive in mesh["primitives"]):
        for attributes in (primitive["attributes"], *primitive.get("targets", [])):
            places += [("accessors", attributes, name) for name in attributes]
        mappings = primitive.get("extensions", {}).get("KHR_materials_variants", {}).get("mappings", [])
        places += [("materials", holder, "material") for holder in (primitive, *mappings) if "material" in holder]
        places += [("accessors", primitive, "indices")] if "indices" in primitive else []
    return places


def _of_textures(pieces: Pieces) -> list[tuple[str, Any, Any]]:
    paint = next(material for material in pieces["materials"] if material["name"] == "Paint")
    infos = [
        paint["normalTexture"],
        paint["pbrMetallicRoughness"]["baseColorTexture"],
        paint["extensions"]["KHR_materials_clearcoat"]["clearcoatTexture"],
    ]
    places: list[tuple[str, Any, Any]] = [("textures", info, "index") for info in infos]
    for texture in pieces["textures"]:
        places += [("images", texture, "source")] + ([("samplers", texture, "sampler")] if "sampler" in texture else [])
        webp = texture.get("extensions", {}).get("EXT_texture_webp")
        places += [("images", webp, "source")] if webp else []
    return places
