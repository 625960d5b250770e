"""A material's entry in a document, with weathered textures in place of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray

from svbrdfgan.asset.painted_texture import NORMAL
from svbrdfgan.asset.sheet import Sheet
from svbrdfgan.asset.weathered_maps import covered, layer_bands, weathered_color, weathered_gloss, weathered_normal
from svbrdfgan.io.gltf.document import Document, Json
from svbrdfgan.io.gltf.materials import DocumentPictures, is_lambertian
from svbrdfgan.io.uv_sets import UVSet

if TYPE_CHECKING:
    from PIL.Image import Image

Bytes = UInt8[ndarray, "rows cols channels"]
Lookup = Callable[[Json], Float[ndarray, "faces 3 2"] | None]

_UNDER_DIRT = {"KHR_materials_clearcoat": "clearcoat", "KHR_materials_transmission": "transmission"}
"""Extensions whose factor fades under the layer, by the prefix of their keys."""


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
        for table, key in (
            (pbr, "baseColorTexture"),
            (pbr, "metallicRoughnessTexture"),
            (self.material, "normalTexture"),
            (self.material, "emissiveTexture"),
        ):
            if key in table:
                yield table[key]

    def uv_set(self) -> UVSet:
        """Where the first of its textures is looked up."""
        return next((UVSet.of(info) for info in self.infos()), UVSet())

    def size(self, longest: int) -> tuple[int, int] | None:
        """Rows and columns of its largest texture, scaled to `longest` if that is not 0; None if it has none."""
        found = [picture.size for info in self.infos() if (picture := self.pictures.of(info)) is not None]
        if not found:
            return None
        cols, rows = max(found, key=lambda size: size[0] * size[1])
        factor = longest / max(rows, cols) if longest else 1.0
        return max(1, round(rows * factor)), max(1, round(cols * factor))

    def weather(self, sheet: Sheet, painted: ndarray, lookup: Lookup, number: int | None) -> None:
        """Replaces the material's textures and factors.

        Args:
            lookup: the UVs, at the corners of the sheet's faces, where one of its own textures was looked up.
            number: of the sheet's UV set, if it is a new one.
        """
        own = next(self.infos(), {})
        place: Json = {key: own[key] for key in ("texCoord", "extensions") if key in own}
        second: Json = {"texCoord": number} if number else {}
        worker = _Worker(self, sheet, lookup, place if number is None else second, number is None)
        pbr = self.material.setdefault("pbrMetallicRoughness", {})
        bands = list(layer_bands(painted, sheet.rows, sheet.cols))
        worker.color(pbr, bands)
        if not is_lambertian(self.material):
            worker.gloss(pbr, bands)
            worker.relief(bands)
        worker.emission(bands)
        worker.under_dirt(bands)


@dataclass(frozen=True, eq=False)
class _Worker:
    weathered: WeatheredMaterial
    sheet: Sheet
    lookup: Lookup
    where: Json
    in_place: bool

    def base(self, info: Json | None) -> Bytes | None:
        """The bytes of a texture over the sheet; None if there is none or it cannot be read."""
        picture: Image | None = self.weathered.pictures.of(info)
        if info is None or picture is None:
            return None
        if self.in_place and UVSet.of(info) == self.weathered.uv_set():
            return self.sheet.resized(picture)
        uv = self.lookup(info)
        return self.sheet.resized(picture) if uv is None else self.sheet.resampled(picture, uv)

    def blank(self, value: int = 255) -> Bytes:
        return np.full((self.sheet.rows, self.sheet.cols, 3), value, np.uint8)

    def texture(self, values: Bytes, old: Json | None) -> Json:
        """The `textureInfo` of a new texture, with the sampler of the old one."""
        from PIL import Image as PillowImage

        stream, document = BytesIO(), self.weathered.document
        PillowImage.fromarray(np.ascontiguousarray(values[::-1])).save(stream, format="PNG", compress_level=3)
        image = document.add("images", {"bufferView": document.add_view(stream.getvalue()), "mimeType": "image/png"})
        entry: Json = {"source": image}
        if old is not None and "sampler" in document.table("textures")[old["index"]]:
            entry["sampler"] = document.table("textures")[old["index"]]["sampler"]
        return {"index": document.add("textures", entry), **self.where}

    def color(self, pbr: Json, bands: list[Any]) -> None:
        *rgb, alpha = pbr.get("baseColorFactor", (1.0, 1.0, 1.0, 1.0))
        old = pbr.get("baseColorTexture")
        base = self.base(old)
        base = self.blank() if base is None else base
        made = base.copy()
        for own, layer in bands:
            made[own] = weathered_color(base[own], np.array(rgb, np.float64), layer)
        pbr["baseColorTexture"], pbr["baseColorFactor"] = self.texture(made, old), [1.0, 1.0, 1.0, alpha]
        if pbr["baseColorFactor"] == [1.0] * 4:
            del pbr["baseColorFactor"]

    def gloss(self, pbr: Json, bands: list[Any]) -> None:
        old = pbr.get("metallicRoughnessTexture")
        base = self.base(old)
        base = self.blank() if base is None else base
        factors = float(pbr.pop("roughnessFactor", 1.0)), float(pbr.pop("metallicFactor", 1.0))
        made = base[..., :3].copy()
        for own, layer in bands:
            made[own] = weathered_gloss(base[own], factors, layer)
        pbr["metallicRoughnessTexture"] = self.texture(made, old)
        occlusion = self.weathered.material.get("occlusionTexture")
        if occlusion is not None and old is not None and occlusion["index"] == old["index"]:
            kept = {key: occlusion[key] for key in ("strength", "extras") if key in occlusion}
            self.weathered.material["occlusionTexture"] = {**pbr["metallicRoughnessTexture"], **kept}

    def relief(self, bands: list[Any]) -> None:
        material = self.weathered.material
        old = material.get("normalTexture")
        flat = all((layer[..., NORMAL.start : NORMAL.stop - 1] == 0.0).all() for _, layer in bands)
        if old is None and flat:
            return
        base = self.base(old)
        made, scale = self.blank(), float((old or {}).get("scale", 1.0))
        for own, layer in bands:
            made[own] = weathered_normal(None if base is None else base[own], scale, layer)
        material["normalTexture"] = self.texture(made, old)

    def emission(self, bands: list[Any]) -> None:
        material = self.weathered.material
        if not any(material.get("emissiveFactor", ())):
            return
        old = material.get("emissiveTexture")
        material["emissiveTexture"] = self._faded(old, bands)

    def under_dirt(self, bands: list[Any]) -> None:
        for name, prefix in _UNDER_DIRT.items():
            entry = self.weathered.material.get("extensions", {}).get(name, {})
            if entry.get(f"{prefix}Factor", 0.0) > 0.0:
                entry[f"{prefix}Texture"] = self._faded(entry.get(f"{prefix}Texture"), bands)

    def _faded(self, old: Json | None, bands: list[Any]) -> Json:
        base = self.base(old)
        base = self.blank() if base is None else base
        made = base.copy()
        for own, layer in bands:
            made[own] = covered(base[own], layer)
        return self.texture(made, old)
