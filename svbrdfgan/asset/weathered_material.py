"""A material's entry in a document, with weathered textures in place of its own."""

from __future__ import annotations

import copy
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from svbrdfgan.asset.material_rules import GLOSS_MAP, NORMAL_MAP, MapRule, take_map_rules
from svbrdfgan.asset.painted_texture import NORMAL, fill
from svbrdfgan.asset.points import SurfacePoints
from svbrdfgan.asset.sheet import Sheet, Source
from svbrdfgan.asset.texture_bands import Band, band
from svbrdfgan.asset.weathered_maps import Layer, layer_bands
from svbrdfgan.io.eight_bit import png_bytes
from svbrdfgan.io.gltf.document import Document, Json
from svbrdfgan.io.gltf.materials import DocumentPictures
from svbrdfgan.io.gltf.samplers import Sampler
from svbrdfgan.io.uv_sets import UVSet
from svbrdfgan.utils.threads import in_threads


@dataclass(frozen=True, eq=False)
class _Map:
    """A new texture in the making: the rule for it, the old texture at the new texels, and the new bytes."""

    rule: MapRule
    source: Source
    made: UInt8[ndarray, "rows cols channels"]


@dataclass(frozen=True, eq=False)
class WeatheredMaterial:
    """A material that is being weathered.

    Attributes:
        document: gets the new textures.
        material: a copy of the file's, to be changed.
        rules: for its maps that weather, colour first.
        pictures: of the file as it was.
    """

    document: Document
    material: Json
    rules: list[MapRule]
    pictures: DocumentPictures

    @classmethod
    def of(
        cls, document: Document, material: Json, pictures: DocumentPictures, painted: Collection[str]
    ) -> WeatheredMaterial:
        """To be made of a copy of the material; what is given stays as it is. The layer paints the maps `painted`."""
        copied = copy.deepcopy(material)
        return cls(document, copied, take_map_rules(copied, painted), pictures)

    def infos(self) -> list[Json]:
        """The `textureInfo`s of the maps that weather, that of the colour first."""
        return [rule.old for rule in self.rules if rule.old is not None]

    def fault(self) -> str | None:
        """Why one of the maps that weather cannot be read; None if all can."""
        return next((fault for info in self.infos() if (fault := self.pictures.fault(info)) is not None), None)

    def repeats(self) -> bool:
        """Whether all of these textures repeat beyond their borders."""
        return all(all(Sampler.of(self.pictures.document, info).repeat) for info in self.infos())

    def uv_set(self) -> UVSet:
        """Where the first of its textures is looked up."""
        return next((UVSet.of(info) for info in self.infos()), UVSet())

    def size(self, longest: int | None) -> tuple[int, int] | None:
        """Rows and columns of its largest texture, scaled to `longest` if that is given; None if it has none."""
        found = [picture.size for info in self.infos() if (picture := self.pictures.of(info)) is not None]
        if not found:
            return None
        cols, rows = max(found, key=lambda size: size[0] * size[1])
        factor = longest / max(rows, cols) if longest else 1.0
        return max(1, round(rows * factor)), max(1, round(cols * factor))

    def weather(self, sheet: Sheet, painted: Layer, number: int | None) -> None:
        """Replaces the material's textures and factors.

        Args:
            number: of the sheet's UV set, if it is a new one.
        """
        own = next(iter(self.infos()), {})
        place: Json = {key: own[key] for key in ("texCoord", "extensions") if key in own}
        second: Json = {"texCoord": number} if number else {}
        relief = bool(painted[..., NORMAL.start : NORMAL.stop - 1].any())
        rules = [rule for rule in self.rules if relief or rule.old is not None or rule.key != NORMAL_MAP]
        maps = [_new(rule, sheet) for rule in rules]
        _compose(maps, sheet, painted)
        textures = [
            self._texture(each, png, place if number is None else second)
            for each, png in zip(maps, in_threads(png_bytes, [each.made for each in maps]), strict=True)
        ]
        for each, info in zip(maps, textures, strict=True):
            if each.rule.key == GLOSS_MAP:
                self._share_occlusion(each.rule.old, info)
            each.rule.owner[each.rule.key] = info

    def _texture(self, each: _Map, png: bytes, where: Json) -> Json:
        """The `textureInfo` of a new texture, with the sampler of the old one."""
        document, old = self.document, each.rule.old
        image = document.add("images", {"bufferView": document.add_view(png), "mimeType": "image/png"})
        entry: Json = {"source": image}
        if old is not None and "sampler" in document.table("textures")[old["index"]]:
            entry["sampler"] = document.table("textures")[old["index"]]["sampler"]
        return {"index": document.add("textures", entry), **where}

    def _share_occlusion(self, old: Json | None, new: Json) -> None:
        """Occlusion that lay in the red of the gloss texture lies in that of the new one."""
        occlusion = self.material.get("occlusionTexture")
        if occlusion is None or old is None or occlusion["index"] != old["index"]:
            return
        if UVSet.of(occlusion) == UVSet.of(old):
            kept = {key: occlusion[key] for key in ("strength", "extras") if key in occlusion}
            self.material["occlusionTexture"] = {**new, **kept}


def _new(rule: MapRule, sheet: Sheet) -> _Map:
    source = rule.source(sheet, rule.old)
    made = np.zeros((sheet.rows, sheet.cols, rule.channels or source.channels), np.uint8)
    return _Map(rule, source, made)


def _compose(maps: list[_Map], sheet: Sheet, painted: Layer) -> None:
    """Fills all new textures, some rows at a time; those that are looked up at points continue beyond the faces."""
    seeking = [each for each in maps if each.source.needs_points]
    known = np.zeros((sheet.rows, sheet.cols), bool)

    def blend(part: tuple[slice, Layer]) -> None:
        own, layer = part
        rows = range(own.start, own.stop)
        here = _points(sheet, rows) if seeking else Band(rows, known[own], _NOWHERE)
        known[own] = here.covered
        for each in maps:
            made = each.rule.compose(each.source.rows(here, sheet.cols), layer)
            each.made[own] = made[..., : each.made.shape[2]]

    for _ in in_threads(blend, layer_bands(painted, sheet.rows, sheet.cols)):
        pass
    for each in seeking:
        fill(each.made, known)


def _points(sheet: Sheet, rows: range) -> Band:
    return band(sheet.canvas.uv, sheet.canvas.faces, (sheet.rows, sheet.cols), rows)


_NOWHERE = SurfacePoints(np.zeros(0, np.int64), np.zeros((0, 3)))
