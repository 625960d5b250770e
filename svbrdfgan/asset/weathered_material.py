"""A material's entry in a document, with weathered textures in place of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from io import BytesIO

import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray

from svbrdfgan.asset.painted_texture import NORMAL, fill
from svbrdfgan.asset.points import SurfacePoints
from svbrdfgan.asset.sheet import Sheet, Source, White
from svbrdfgan.asset.texture_bands import Band, band
from svbrdfgan.asset.weathered_maps import covered, layer_bands, weathered_color, weathered_gloss, weathered_normal
from svbrdfgan.io.gltf.document import Document, Json
from svbrdfgan.io.gltf.materials import DocumentPictures, is_lambertian
from svbrdfgan.io.uv_sets import UVSet
from svbrdfgan.utils.threads import in_threads

Bytes = UInt8[ndarray, "rows cols channels"]
Layer = Float[ndarray, "rows cols channels"]

_UNDER_DIRT = {"KHR_materials_clearcoat": "clearcoat", "KHR_materials_transmission": "transmission"}
"""Extensions whose factor fades under the layer, by the prefix of their keys."""


@dataclass(eq=False)
class _Map:
    """A new texture in the making.

    Attributes:
        owner, key: the table that names it, and under which key.
        old: the `textureInfo` that it replaces.
        source: the old texture at the new texels.
        compose: of its bytes and the layer, the bytes under the layer.
        made: the new texture.
    """

    owner: Json
    key: str
    source: Source
    compose: Callable[[Bytes, Layer], Bytes]
    made: Bytes

    @property
    def old(self) -> Json | None:
        found: Json | None = self.owner.get(self.key)
        return found


@dataclass(eq=False)
class WeatheredMaterial:
    """A material that is being weathered.

    Attributes:
        document: gets the new textures.
        material: a copy of the file's, to be changed.
        pictures: of the file as it was.
    """

    document: Document
    material: Json
    pictures: DocumentPictures

    def infos(self) -> Iterator[Json]:
        """The `textureInfo`s of the maps that weather, that of the base colour first."""
        pbr = self.material.get("pbrMetallicRoughness", {})
        places = ((pbr, "baseColorTexture"), (pbr, "metallicRoughnessTexture"))
        for table, key in (*places, (self.material, "normalTexture"), (self.material, "emissiveTexture")):
            if key in table:
                yield table[key]

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
        own = next(self.infos(), {})
        place: Json = {key: own[key] for key in ("texCoord", "extensions") if key in own}
        second: Json = {"texCoord": number} if number else {}
        maps = self._maps(sheet, painted)
        _compose(maps, sheet, painted)
        pngs = in_threads(_png, [each.made for each in maps])
        textures = [
            self._texture(each, png, place if number is None else second) for each, png in zip(maps, pngs, strict=True)
        ]
        self._share_occlusion(maps, textures)
        for each, info in zip(maps, textures, strict=True):
            each.owner[each.key] = info

    def _maps(self, sheet: Sheet, painted: Layer) -> list[_Map]:
        """What is to be made. The factors that new textures hold leave the material."""
        material, pbr = self.material, self.material.setdefault("pbrMetallicRoughness", {})
        *rgb, alpha = pbr.pop("baseColorFactor", (1.0, 1.0, 1.0, 1.0))
        if alpha != 1.0:
            pbr["baseColorFactor"] = [1.0, 1.0, 1.0, alpha]
        maps = [_new(pbr, "baseColorTexture", sheet, partial(weathered_color, np.array(rgb, np.float64)))]
        if not is_lambertian(material):
            factors = float(pbr.pop("roughnessFactor", 1.0)), float(pbr.pop("metallicFactor", 1.0))
            maps.append(_new(pbr, "metallicRoughnessTexture", sheet, partial(weathered_gloss, factors)))
            old = material.get("normalTexture")
            if old is not None or painted[..., NORMAL.start : NORMAL.stop - 1].any():
                scale = float((old or {}).get("scale", 1.0))
                relief = _new(material, "normalTexture", sheet, partial(weathered_normal, scale))
                relief.compose = partial(weathered_normal, None if isinstance(relief.source, White) else scale)
                maps.append(relief)
        if any(material.get("emissiveFactor", ())):
            maps.append(_new(material, "emissiveTexture", sheet, covered))
        for name, prefix in _UNDER_DIRT.items():
            entry = material.get("extensions", {}).get(name, {})
            if entry.get(f"{prefix}Factor", 0.0) > 0.0:
                maps.append(_new(entry, f"{prefix}Texture", sheet, covered))
        return maps

    def _texture(self, each: _Map, png: bytes, where: Json) -> Json:
        """The `textureInfo` of a new texture, with the sampler of the old one."""
        document, old = self.document, each.old
        image = document.add("images", {"bufferView": document.add_view(png), "mimeType": "image/png"})
        entry: Json = {"source": image}
        if old is not None and "sampler" in document.table("textures")[old["index"]]:
            entry["sampler"] = document.table("textures")[old["index"]]["sampler"]
        return {"index": document.add("textures", entry), **where}

    def _share_occlusion(self, maps: list[_Map], textures: list[Json]) -> None:
        """Occlusion that lay in the red of the gloss texture lies in that of the new one."""
        occlusion, pbr = self.material.get("occlusionTexture"), self.material["pbrMetallicRoughness"]
        old = pbr.get("metallicRoughnessTexture")
        if (
            occlusion is None
            or old is None
            or occlusion["index"] != old["index"]
            or UVSet.of(occlusion) != UVSet.of(old)
        ):
            return
        kept = {key: occlusion[key] for key in ("strength", "extras") if key in occlusion}
        for each, info in zip(maps, textures, strict=True):
            if each.key == "metallicRoughnessTexture":
                self.material["occlusionTexture"] = {**info, **kept}


def _png(made: Bytes) -> bytes:
    """The file of a texture, whose row 0 is at v = 0."""
    from PIL import Image as PillowImage

    stream = BytesIO()
    PillowImage.fromarray(np.ascontiguousarray(made[::-1])).save(stream, format="PNG", compress_level=3)
    return stream.getvalue()


def _new(owner: Json, key: str, sheet: Sheet, compose: Callable[[Bytes, Layer], Bytes]) -> _Map:
    source = sheet.source(owner.get(key))
    channels = source.channels if key == "baseColorTexture" else 3
    return _Map(owner, key, source, compose, np.zeros((sheet.rows, sheet.cols, channels), np.uint8))


def _compose(maps: list[_Map], sheet: Sheet, painted: Layer) -> None:
    """Fills all new textures, some rows at a time."""
    seeking = any(each.source.needs_points for each in maps)
    known = np.zeros((sheet.rows, sheet.cols), bool)

    def blend(part: tuple[slice, Layer]) -> None:
        own, layer = part
        rows = range(own.start, own.stop)
        here = _points(sheet, rows) if seeking else Band(rows, known[own], _NOWHERE)
        known[own] = here.covered
        for each in maps:
            each.made[own] = each.compose(each.source.rows(here, sheet.cols), layer)

    for _ in in_threads(blend, layer_bands(painted, sheet.rows, sheet.cols)):
        pass
    if seeking:
        for each in maps:
            fill(each.made, known)


def _points(sheet: Sheet, rows: range) -> Band:
    return band(sheet.canvas.uv, sheet.canvas.faces, (sheet.rows, sheet.cols), rows)


_NOWHERE = SurfacePoints(np.zeros(0, np.int64), np.zeros((0, 3)))
