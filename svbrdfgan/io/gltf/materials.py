"""What a glTF document says of its materials, as the looks of parts."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from svbrdfgan.errors import AssetError
from svbrdfgan.io.gltf.document import Document, Json, picture_bytes
from svbrdfgan.io.gltf_codecs.pictures import decode_picture
from svbrdfgan.io.materials import Look, Pictures, unit_interval
from svbrdfgan.io.uv_sets import UVSet
from svbrdfgan.types import FileMap, Part

if TYPE_CHECKING:
    from PIL.Image import Image

log = logging.getLogger(__name__)

LAMBERTIAN = "lambertian"
"""The key in a material's `extras` by which files of this package mark parts without gloss: glTF knows no such part."""

SPECULAR_GLOSSINESS = "KHR_materials_pbrSpecularGlossiness"
TEXTURES = ("baseColorTexture", "metallicRoughnessTexture", "normalTexture")
"""The textures that looks are made of."""

_SOURCES = ("KHR_texture_basisu", "EXT_texture_webp", "EXT_texture_avif", "MSFT_texture_dds")
_CUTOFF = 0.5
"""glTF's default of `alphaCutoff`."""


@dataclass(frozen=True, eq=False)
class DocumentPictures:
    """The pictures of a document, each opened once.

    Attributes:
        quiet: whether those that cannot be read cause no warning, since `fault` is told.
    """

    document: Document
    quiet: bool = False
    _opened: dict[int, Image | str] = field(default_factory=dict)

    def of(self, info: Mapping[str, Any] | None) -> Image | None:
        """The picture of a `textureInfo`; None if there is none, or, with a warning, if it cannot be read."""
        found = self._found(info)
        return None if isinstance(found, str) else found

    def fault(self, info: Mapping[str, Any]) -> str | None:
        """Why the picture of a `textureInfo` cannot be read; None if it can."""
        found = self._found(info)
        return found if isinstance(found, str) else None

    def _found(self, info: Mapping[str, Any] | None) -> Image | str | None:
        """The first picture of a texture that can be read, or why the first cannot."""
        if info is None:
            return None
        numbers = images_of(self.document, info["index"])
        for number in numbers:
            if number not in self._opened:
                self._opened[number] = self._open(number)
            if not isinstance(self._opened[number], str):
                return self._opened[number]
        return self._opened[numbers[0]] if numbers else f"texture {info['index']} names no picture"

    def _open(self, number: int) -> Image | str:
        if not 0 <= number < len(self.document.table("images")):
            return f"picture {number} is missing"
        entry = self.document.table("images")[number]
        try:
            return decode_picture(picture_bytes(self.document, number), entry.get("mimeType"))
        except (AssetError, OSError, ValueError) as error:
            level = logging.DEBUG if self.quiet else logging.WARNING
            log.log(level, "%s: picture %d cannot be read (%s)", self.document.path, number, error)
            return str(error)


def images_of(document: Document, texture: int) -> list[int]:
    """The indices of a texture's images: those of other formats, which extensions name, before the plain one."""
    textures = document.table("textures")
    entry = textures[texture] if 0 <= texture < len(textures) else {}
    named = [entry.get("extensions", {}).get(name, {}) for name in _SOURCES]
    return [each["source"] for each in (*named, entry) if "source" in each]


def look_of(pictures: DocumentPictures, decoded: Pictures, name: str, material: Json) -> Look:
    """The look of a material; specular-glossiness counts as a dielectric of that roughness, and unlit as Lambertian.

    Args:
        name: of the part, if the material has none.
    """
    pbr, found = metallic_roughness(material), {**metallic_roughness(material), **material}
    infos = {key: found[key] for key in TEXTURES if key in found}
    sets = {key: UVSet.of(info) for key, info in infos.items()}
    further = tuple(dict.fromkeys(uv_set for uv_set in sets.values() if uv_set != UVSet()))
    color, gloss, normal = ((UVSet(), *further).index(sets.get(key, UVSet())) for key in TEXTURES)
    opened = {key: pictures.of(info) for key, info in infos.items()}
    for key in sorted(key for key, image in opened.items() if image is None):
        log.warning(
            "%s: the picture %s of material '%s' cannot be read; its numbers are used alone",
            *(pictures.document.path, key, material.get("name")),
        )
    *rgb, alpha = pbr.get("baseColorFactor", (1.0, 1.0, 1.0, 1.0))
    image = opened.get("baseColorTexture")
    maps = {"alpha": _alpha(decoded, material, image, FileMap(unit_interval((float(alpha),)), uv_set=color))}
    maps |= _gloss(decoded, material, pbr, opened.get("metallicRoughnessTexture"), gloss)
    relief = decoded.normal(opened.get("normalTexture"))
    if relief is not None:
        scale = float(material["normalTexture"].get("scale", 1.0))
        maps["normal"] = FileMap((scale, scale, 1.0), relief, uv_set=normal)
    given = {key: maps[key] for key in ("alpha", "normal", "roughness", "metallic") if maps.get(key) is not None}
    stored = material.get("name")
    part = Part(
        stored if isinstance(stored, str) and stored else name,
        unit_interval(tuple(map(float, rgb))),
        decoded.color(image),
        file_maps={key: value for key, value in given.items() if value is not None},
        texture_uv_set=color,
    )
    return Look(part, further)


def is_lambertian(material: Json) -> bool:
    """Whether light on a material has no gloss: it is unlit, or this package wrote it for a part without any."""
    extras = material.get("extras")
    marked = isinstance(extras, dict) and extras.get(LAMBERTIAN) is True
    return marked or "KHR_materials_unlit" in material.get("extensions", {})


def metallic_roughness(material: Json) -> Json:
    """The keys of `pbrMetallicRoughness`, made of those of specular-glossiness where a material has these."""
    other = material.get("extensions", {}).get(SPECULAR_GLOSSINESS)
    pbr: Json = material.get("pbrMetallicRoughness", {})
    if other is None:
        return pbr
    made = {"metallicFactor": 0.0, "roughnessFactor": 1.0 - float(other.get("glossinessFactor", 1.0))}
    made["baseColorFactor"] = other.get("diffuseFactor", (1.0, 1.0, 1.0, 1.0))
    same = {"baseColorTexture": "diffuseTexture", "metallicRoughnessTexture": "specularGlossinessTexture"}
    return made | {key: other[name] for key, name in same.items() if name in other}


def _gloss(decoded: Pictures, material: Json, pbr: Json, image: Image | None, uv_set: int) -> dict[str, FileMap | None]:
    if is_lambertian(material):
        return {}
    if SPECULAR_GLOSSINESS in material.get("extensions", {}):
        smooth, most = decoded.numbers(image, 3), 1.0 - pbr["roughnessFactor"]
        rough = FileMap((1.0 - most,)) if smooth is None else FileMap((1.0,), 1.0 - most * smooth, uv_set=uv_set)
        return {"roughness": rough, "metallic": FileMap((0.0,))}
    factor, metallic = (_factor(pbr.get(key)) for key in ("roughnessFactor", "metallicFactor"))
    return {
        "roughness": FileMap(factor, decoded.numbers(image, 1), uv_set=uv_set),
        "metallic": FileMap(metallic, decoded.numbers(image, 2), uv_set=uv_set),
    }


def _alpha(decoded: Pictures, material: Json, image: Image | None, whole: FileMap) -> FileMap | None:
    """Alpha by the material's `alphaMode`; None if it is opaque."""
    mode = material.get("alphaMode")
    if mode not in ("MASK", "BLEND"):
        return None
    cutoff = float(material.get("alphaCutoff", _CUTOFF)) if mode == "MASK" else None
    texture = decoded.numbers(image, 3)
    if texture is None and whole.factor[0] >= (1.0 if cutoff is None else cutoff):
        return None
    return FileMap(whole.factor, texture, cutoff, whole.uv_set)


def _factor(number: float | None) -> tuple[float]:
    """A factor of glTF, whose default is 1."""
    return unit_interval((1.0 if number is None else float(number),))
