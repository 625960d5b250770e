"""How much memory weathering takes at its peak, and whether that is allowed."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace

import torch

from svbrdfgan.asset.asset import BYTES_PER_TRIANGLE, Asset
from svbrdfgan.asset.weather_document import DEFAULT_SIZE, Textures, enough_texels
from svbrdfgan.asset.weathered_maps import BAND
from svbrdfgan.asset.weathered_material import WeatheredMaterial
from svbrdfgan.geometry.normals import face_areas
from svbrdfgan.io.gltf.materials import DocumentPictures
from svbrdfgan.types import FURTHER_MAPS
from svbrdfgan.utils.memory import PROGRAM, require_memory

_LEAST = 256
"""Texels along a side: no smaller textures are suggested."""

_PAINTED = 19  # a layer's texel: nine channels of 16 bits, and whether it is known
_FILLING = 20  # more while the texels around the faces are filled
_OLD = 32  # a texel of an old texture: its bytes, as part of the looks, and as float32 when it is looked up
_NEW = 3  # a texel of a new texture
_BLENDING = 440  # a texel of a band of rows, of which each thread blends one at a time
_ENCODING = 16  # a texel, while textures are filled and become PNG files
_STORED = 2.5  # a texel of a new texture as PNG, which noise hardly lets shrink


def peak_bytes(
    rows: int, cols: int, layer: tuple[int, int], *, maps: int = 3, old: Collection[int] = (), triangles: int = 0
) -> int:
    """What the process holds at most while one material is weathered.

    Args:
        rows, cols: of the new textures.
        layer: rows and columns at which the layer is painted.
        maps: the number of new textures.
        old: texels of each texture that they replace.
        triangles: of the whole model.
    """
    texels, painted = rows * cols, layer[0] * layer[1]
    bands = min(torch.get_num_threads(), math.ceil(rows / BAND))
    painting = (_PAINTED + _FILLING) * painted
    blending = (
        _PAINTED * painted + _OLD * sum(old) + (_NEW * maps + _ENCODING) * texels + _BLENDING * bands * BAND * cols
    )
    return PROGRAM + BYTES_PER_TRIANGLE * triangles + max(painting, blending)


@dataclass(frozen=True)
class Plan:
    """What is to be weathered, one material after another.

    Attributes:
        triangles: of the whole model.
        materials: of each weathered material, rows and columns of its textures.
        textures: how large new ones will be.
        enough: of each of them, the size of its textures if it has none; by default as large as they become.
    """

    triangles: int
    materials: tuple[tuple[tuple[int, int], ...], ...]
    textures: Textures
    enough: tuple[int, ...] = ()

    @classmethod
    def of(cls, asset: Asset, weathers: Collection[int], textures: Textures) -> Plan:
        """The plan for the pieces of these numbers."""
        areas, shares = face_areas(asset.mesh.positions, asset.mesh.faces), dict[int | None, float]()
        for piece in weathers:
            number = asset.primitive(piece).get("material")
            shares[number] = shares.get(number, 0.0) + float(areas[asset.faces(piece)].sum() / areas.sum())
        enough = tuple(enough_texels(share, textures.painted) for share in shares.values())
        return cls(len(asset.mesh.faces), tuple(_old(asset, number) for number in shares), textures, enough)

    def as_overlay(self) -> Plan:
        """The plan of one layer beside the file, over all that weathers."""
        return replace(self, materials=((),), enough=())

    def peak_bytes(self) -> int:
        """What the process holds at most, files in memory included; never much less than it is."""
        most, stored = 0, 0.0
        for old, enough in zip(self.materials, self.enough or [DEFAULT_SIZE] * len(self.materials), strict=True):
            side = self.textures.size or max((max(size) for size in old), default=enough)
            texels = [rows * cols for rows, cols in old]
            maps = max(3, len(old))
            stored += _STORED * maps * side * side
            # at most twice the texels of the resolution are painted, whatever the share of one material
            layer = min(side, round(1.5 * self.textures.painted))
            one = peak_bytes(side, side, (layer, layer), maps=maps, old=texels, triangles=self.triangles)
            most = max(most, one)
        return most + round(stored)

    def smaller(self) -> Iterator[Plan]:
        """The same with textures half as large, again and again, and layers that are no larger than they."""
        size, painted = self.textures.size or self._largest(), self.textures.painted
        while size >= 2 * _LEAST:
            size //= 2
            painted = min(painted, size)
            yield replace(self, textures=Textures(size, painted))

    def _largest(self) -> int:
        return max((max(size) for old in self.materials for size in old), default=DEFAULT_SIZE)


def require_plan(plan: Plan, further: int = 0, *, sized: bool = True) -> int:
    """Checks that a plan may run, and gives the bytes that it takes at most.

    Args:
        further: bytes that are held besides, such as a model's layers.
        sized: whether the size of textures is the user's choice, besides how fine the layer is.

    Raises:
        ConfigError: the plan needs more than is allowed.
    """

    def fitting(allowed: int) -> str | None:
        others = (other.textures for other in plan.smaller() if other.peak_bytes() + further <= allowed)
        return next((f"{f'--size {it.size} ' * sized}--resolution {it.painted}" for it in others), None)

    instead = "no smaller textures fit either: allow more by --memory"
    return require_memory("weathering needs", plan.peak_bytes() + further, fitting, instead=instead)


def _old(asset: Asset, number: int | None) -> tuple[tuple[int, int], ...]:
    """Rows and columns of a material's textures."""
    if number is None:
        return ()
    pictures = DocumentPictures(asset.document, quiet=True)
    material = WeatheredMaterial.of(asset.document, asset.document.table("materials")[number], pictures, FURTHER_MAPS)
    found = (pictures.of(info) for info in material.infos())
    return tuple(picture.size[::-1] for picture in found if picture is not None)
