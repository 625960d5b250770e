"""One layer beside a file, over a further UV set of all that weathers, for those who composite themselves."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, UInt8
from numpy import ndarray

from svbrdfgan.asset.asset import Asset
from svbrdfgan.asset.painted_texture import (
    ALPHA,
    COLOR,
    METALLIC,
    NORMAL,
    ROUGHNESS,
    Canvas,
    Model,
    paint_texture,
    painted_scale,
)
from svbrdfgan.asset.painters import Painter
from svbrdfgan.asset.piece_editor import NewUVSet, PieceEditor
from svbrdfgan.asset.piece_groups import free_uv_set, groups
from svbrdfgan.asset.second_uv_set import fitting_uv_set
from svbrdfgan.asset.weather_document import DEFAULT_SIZE, Edited, Textures
from svbrdfgan.asset.weathered_maps import Layer, layer_bands
from svbrdfgan.geometry.normals import unit
from svbrdfgan.io.image import Encoding, picture
from svbrdfgan.utils.display import Display

Maps = dict[str, UInt8[ndarray, "rows cols channels"]]
"""A layer's textures, row 0 at v = 0: `base_color` (RGBA, straight alpha, sRGB), and if they are painted `orm`
(occlusion, which is 1, roughness and metallic) and `normal` (in the tangent frames of the UV set)."""


@dataclass(frozen=True, eq=False)
class Overlay:
    """A layer, and the document over whose further UV set it lies."""

    edited: Edited
    maps: Maps


@dataclass(frozen=True, eq=False)
class OverlayCanvas:
    """A further UV set, without overlaps, over all pieces that weather together.

    Attributes:
        edited: the document with that UV set.
        canvas: the faces over it.
        number: of the UV set.
        size: texels along a side of textures that are fine enough to keep its charts apart.
    """

    edited: Edited
    canvas: Canvas
    number: int
    size: int

    @classmethod
    def of(cls, asset: Asset, model: Model, weathers: Collection[int], size: int) -> OverlayCanvas:
        """The canvas over the pieces of these numbers.

        Args:
            size: texels along a side; more are taken if there are many charts.

        Raises:
            ChartsError: the pieces have too many charts for any texture.
            AssetError: xatlas is missing.
        """
        edited = Edited.of(asset)
        pieces = [piece for group in groups(asset, weathers) for piece in group.pieces]
        faces = np.flatnonzero(np.isin(asset.face_piece, pieces))
        own, number = asset.mesh.uv, free_uv_set(asset, pieces)
        positions = model.mesh.positions[model.mesh.faces[faces]]
        uv, size = fitting_uv_set(positions, None if own is None else own[faces], size)
        PieceEditor(edited.document, asset, edited.told).add_uv_set(pieces, NewUVSet(number, faces, uv))
        return cls(edited, Canvas(model, faces, uv), number, size)


def overlay_document(
    asset: Asset,
    model: Model,
    painter: Painter,
    weathers: Collection[int],
    textures: Textures,
    *,
    display: Display | None = None,
) -> Overlay:
    """The asset's document, whose pieces of these numbers have one further UV set together, and a layer over it.

    Raises:
        ChartsError: the pieces have too many charts for any texture.
        AssetError: xatlas is missing.
    """
    over = OverlayCanvas.of(asset, model, weathers, textures.size or DEFAULT_SIZE)
    over.edited.told.append(
        f"the layer lies over TEXCOORD_{over.number} of all that weathers, at {over.size} texels a side."
    )
    side = over.size // painted_scale(over.canvas, textures.painted, over.size, over.size)
    painted = paint_texture(over.canvas, painter, side, side, f"painting the layer of {asset.path.name}", display)
    return Overlay(over.edited, layer_maps(painted, over.size, painter.maps))


def layer_maps(painted: Layer, size: int, further: Collection[str]) -> Maps:
    """The textures of a painted layer.

    Args:
        size: texels along a side.
        further: the maps that are painted besides base colour.
    """
    channels = {"base_color": 4}
    channels |= {"orm": 3} if {"roughness", "metallic"} & set(further) else {}
    channels |= {"normal": 3} if "normal" in further else {}
    made = {name: np.zeros((size, size, count), np.uint8) for name, count in channels.items()}
    for rows, layer in layer_bands(painted, size, size):
        found = {
            "base_color": _bytes(np.dstack([layer[..., COLOR], layer[..., ALPHA]]), "srgb"),
            "orm": _bytes(np.dstack([np.ones(layer.shape[:2]), layer[..., ROUGHNESS], layer[..., METALLIC]]), "raw"),
            "normal": _bytes(0.5 + 0.5 * unit(layer[..., NORMAL]), "raw"),
        }
        for name, texture in made.items():
            texture[rows] = found[name]
    return made


def _bytes(values: Float[ndarray, "rows cols channels"], encoding: Encoding) -> UInt8[ndarray, "rows cols channels"]:
    return np.asarray(picture(torch.from_numpy(values), encoding))
