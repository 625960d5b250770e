"""Which maps of a glTF material a layer changes, and how: the table in `docs/conventions.md`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from svbrdfgan.asset.sheet import Sheet, Source
from svbrdfgan.asset.weathered_maps import (
    Bytes,
    Layer,
    Paint,
    covered_color,
    paint_color,
    paint_diffuse,
    translucent_color,
    weathered_channel,
    weathered_color,
    weathered_gloss,
    weathered_normal,
    weathered_specular_gloss,
)
from svbrdfgan.io.gltf.document import Json
from svbrdfgan.io.gltf.materials import SPECULAR_GLOSSINESS, is_lambertian

NORMAL_MAP, GLOSS_MAP = "normalTexture", "metallicRoughnessTexture"

_FADING = (
    ("KHR_materials_clearcoat", "clearcoat", 0),
    ("KHR_materials_transmission", "transmission", 0),
    ("KHR_materials_iridescence", "iridescence", 0),
    ("KHR_materials_diffuse_transmission", "diffuseTransmission", 3),
)
"""Extensions that do nothing under dirt: their names, the prefixes of their keys, the channels of their factors."""

_WHITE = (1.0, 1.0, 1.0, 1.0)


@dataclass(frozen=True, eq=False)
class MapRule:
    """A texture that is to be replaced or made.

    Attributes:
        owner, key: the table that names it, and under which key.
        compose: of the old texture's RGBA and the layer, the new RGBA.
        channels: of the new texture; None for those of the old one.
        source: of a sheet, that finds the old texture.
    """

    owner: Json
    key: str
    compose: Callable[[Bytes, Layer], Bytes]
    channels: int | None = None
    source: Callable[[Sheet, Json | None], Source] = Sheet.source

    @property
    def old(self) -> Json | None:
        """The `textureInfo` that is replaced."""
        found: Json | None = self.owner.get(self.key)
        return found


def take_map_rules(material: Json) -> list[MapRule]:
    """The maps of a material that weather, colour first. Factors that the new textures hold leave the material."""
    gloss = not is_lambertian(material)
    rules = [*_specular_glossiness(material)] if gloss else []
    if not rules or "pbrMetallicRoughness" in material:
        rules += _metallic_roughness(material, gloss=gloss)
    return [*rules, *_normal(material), *_emission(material), *_extensions(material)] if gloss else rules


def _metallic_roughness(material: Json, *, gloss: bool) -> Iterator[MapRule]:
    pbr = material.setdefault("pbrMetallicRoughness", {})
    yield _color(material, pbr, ("baseColorTexture", "baseColorFactor"), paint_color)
    if gloss:
        factors = float(pbr.pop("roughnessFactor", 1.0)), float(pbr.pop("metallicFactor", 1.0))
        yield MapRule(pbr, GLOSS_MAP, partial(weathered_gloss, factors))


def _specular_glossiness(material: Json) -> Iterator[MapRule]:
    entry = material.get("extensions", {}).get(SPECULAR_GLOSSINESS)
    if entry is not None:
        yield _color(material, entry, ("diffuseTexture", "diffuseFactor"), paint_diffuse)
        factor = [*entry.pop("specularFactor", _WHITE[:3]), entry.pop("glossinessFactor", 1.0)]
        compose = partial(weathered_specular_gloss, np.array(factor, np.float32))
        yield MapRule(entry, "specularGlossinessTexture", compose, channels=4)


def _color(material: Json, owner: Json, keys: tuple[str, str], paint: Paint) -> MapRule:
    *rgb, alpha = owner.pop(keys[1], _WHITE)
    if material.get("alphaMode") == "BLEND":
        factor = np.array([*rgb, alpha], np.float32)
        return MapRule(owner, keys[0], partial(translucent_color, factor, paint), channels=4, source=Sheet.color_source)
    if alpha != 1.0:
        owner[keys[1]] = [1.0, 1.0, 1.0, alpha]
    return MapRule(
        owner, keys[0], partial(weathered_color, np.array(rgb, np.float32), paint), source=Sheet.color_source
    )


def _normal(material: Json) -> Iterator[MapRule]:
    old = material.get(NORMAL_MAP)
    scale = None if old is None else float(old.get("scale", 1.0))
    yield MapRule(material, NORMAL_MAP, partial(weathered_normal, scale), source=Sheet.normal_source)


def _emission(material: Json) -> Iterator[MapRule]:
    if any(material.get("emissiveFactor", ())):
        yield MapRule(material, "emissiveTexture", covered_color)


def _extensions(material: Json) -> Iterator[MapRule]:
    extensions = material.get("extensions", {})
    for name, prefix, channel in _FADING:
        entry = extensions.get(name, {})
        if entry.get(f"{prefix}Factor", 0.0) > 0.0:
            compose = partial(weathered_channel, channel, 1.0, 0.0)
            yield MapRule(entry, f"{prefix}Texture", compose, channels=4 if channel == 3 else None)
    sheen = extensions.get("KHR_materials_sheen", {})
    if any(sheen.get("sheenColorFactor", ())):
        yield MapRule(sheen, "sheenColorTexture", covered_color)
    specular = extensions.get("KHR_materials_specular", {})
    if "specularTexture" in specular or specular.get("specularFactor", 1.0) != 1.0:
        factor = float(specular.pop("specularFactor", 1.0))
        compose = partial(weathered_channel, 3, factor, 1.0)
        yield MapRule(specular, "specularTexture", compose, channels=4)
