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
    paint_texture,
    painted_scale,
)
from svbrdfgan.asset.painters import Painter
from svbrdfgan.asset.piece_editor import NewUVSet, PieceEditor
from svbrdfgan.asset.piece_groups import free_uv_set, groups
from svbrdfgan.asset.second_uv_set import fitting_uv_set
from svbrdfgan.asset.weather_document import DEFAULT_SIZE, Edited, Model, Textures
from svbrdfgan.asset.weathered_maps import Layer, layer_bands
from svbrdfgan.geometry.normals import unit
from svbrdfgan.io.image import Encoding, picture
from svbrdfgan.utils.display import Display


@dataclass(frozen=True, eq=False)
class Overlay:
    """A layer, and the document over whose further UV set it lies.

    Attributes:
        maps: `base_color` (RGBA, straight alpha, sRGB), and if they are painted `orm` (occlusion, which is 1, roughness
            and metallic) and `normal` (in the tangent frames of the UV set); row 0 at v = 0.
    """

    edited: Edited
    maps: dict[str, UInt8[ndarray, "rows cols channels"]]


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
    edited = Edited.of(asset)
    pieces = [piece for group in groups(asset, weathers) for piece in group.pieces]
    faces = np.flatnonzero(np.isin(asset.face_piece, pieces))
    own, number = asset.mesh.uv, free_uv_set(asset, pieces)
    positions = model.mesh.positions[model.mesh.faces[faces]]
    uv, size = fitting_uv_set(positions, None if own is None else own[faces], textures.size or DEFAULT_SIZE)
    edited.told.append(f"the layer lies over TEXCOORD_{number} of all that weathers, at {size} texels a side.")
    canvas = Canvas(model.mesh, faces, uv, model.reversed)
    scale = painted_scale(canvas, textures.painted, size, size)
    painted = paint_texture(
        canvas, painter, size // scale, size // scale, f"painting the layer of {asset.path.name}", display
    )
    PieceEditor(edited.document, asset, edited.told).add_uv_set(pieces, NewUVSet(number, faces, uv))
    return Overlay(edited, _maps(painted, size, painter.maps))


def _maps(painted: Layer, size: int, further: Collection[str]) -> dict[str, UInt8[ndarray, "rows cols channels"]]:
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
