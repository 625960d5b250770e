"""Edit a document so that pieces of it weather: new textures for their materials, and nothing else."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan.asset.asset import Asset
from svbrdfgan.asset.clean_variants import has_variants, list_variants
from svbrdfgan.asset.freed_places import take_freed_places
from svbrdfgan.asset.material_rules import NORMAL_MAP
from svbrdfgan.asset.packing import ChartsError
from svbrdfgan.asset.painted_texture import Canvas, Model, paint_texture, painted_scale
from svbrdfgan.asset.painters import Painter
from svbrdfgan.asset.piece_editor import NewUVSet, PieceEditor
from svbrdfgan.asset.piece_groups import Group, free_uv_set, groups
from svbrdfgan.asset.second_uv_set import fitting_uv_set
from svbrdfgan.asset.sheet import Sheet
from svbrdfgan.asset.tangent_turns import turn_layer, turns_of_file
from svbrdfgan.asset.uv_fitness import uv_fitness, wrapped
from svbrdfgan.asset.weathered_material import WeatheredMaterial
from svbrdfgan.io.gltf.document import Document
from svbrdfgan.io.gltf.materials import DocumentPictures
from svbrdfgan.utils.display import Display

DEFAULT_SIZE = 2048
"""Texels along a side at most, for materials without a texture."""

_LEAST_SIZE = 128

_BEYOND = 1e-3  # of a tile: how far UVs may pass its border


@dataclass(frozen=True)
class Textures:
    """How large textures are.

    Attributes:
        size: texels along the longer side of new textures; None keeps that of each material's own, and else takes what
            the layer needs.
        painted: texels along a side of a texture over the whole model, by whose density the layer is painted.
    """

    size: int | None = None
    painted: int = 1024


@dataclass(eq=False)
class Edited:
    """A document under change.

    Attributes:
        told: one sentence for each thing that was done beyond new textures.
        materials: the numbers of those that weather.
    """

    document: Document
    told: list[str] = field(default_factory=list)
    materials: list[int] = field(default_factory=list)

    @classmethod
    def of(cls, asset: Asset) -> Edited:
        """A copy of the asset's document, to be changed; what reading it has changed already is told."""
        return cls(asset.document.copy(), list(asset.document.changes))


def weather_document(
    asset: Asset,
    model: Model,
    painter: Painter,
    weathers: Collection[int],
    textures: Textures,
    *,
    variants: bool = False,
    display: Display | None = None,
) -> Edited:
    """The asset's document with a layer on the pieces of these numbers; the asset itself stays as it is.

    Materials with a picture that cannot be read, or with too many charts for any texture, stay clean.

    Args:
        variants: whether the clean materials are kept, too, and listed as a variant.
    """
    edited, found = Edited.of(asset), list(groups(asset, weathers))
    for group in found:
        _weather_group(edited, model, painter, group, textures, display)
    if variants and has_variants(asset.document):
        edited.told.append(f"{asset.path.name} has variants already; clean and weathered are not listed.")
    elif variants and edited.materials:
        edited.told += list_variants(edited.document, found, edited.materials)
    take_freed_places(edited.document, asset.document)
    return edited


def _weather_group(
    edited: Edited, model: Model, painter: Painter, group: Group, textures: Textures, display: Display | None
) -> None:
    pictures = DocumentPictures(group.asset.document, quiet=True)
    changed = WeatheredMaterial.of(edited.document, group.entry, pictures, painter.maps)
    if (fault := changed.fault()) is not None:
        edited.told.append(f"'{group.name}' stays clean: {fault.rstrip('.')}.")
        return
    try:
        places = _places(edited, model, group, changed, textures)
    except ChartsError as error:
        edited.told.append(f"'{group.name}' stays clean: {error}")
        return
    canvas, rows, cols = places.canvas, places.rows, places.cols
    scale = painted_scale(canvas, textures.painted, rows, cols)
    painted = paint_texture(
        canvas, painter, rows // scale, cols // scale, f"painting {group.name} of {group.asset.path.name}", display
    )
    own, normal = changed.uv_set() if places.number is None else None, changed.material.get(NORMAL_MAP)
    turn_layer(painted, canvas, group, normal, own)
    turns = turns_of_file(canvas, group, normal, own)
    sheet = Sheet(canvas, rows, cols, own, group.uv, pictures, group.vertex_colors(), turns)
    changed.weather(sheet, painted, places.number)
    second = None if places.number is None else NewUVSet(places.number, group.faces, canvas.uv)
    editor = PieceEditor(edited.document, group.asset, edited.told)
    edited.materials.append(editor.assign(group, changed.material, second))


@dataclass(frozen=True, eq=False)
class _Places:
    """Where a group's new textures lie: the canvas, their size, and the number of its UV set if that is new."""

    canvas: Canvas
    rows: int
    cols: int
    number: int | None = None


def _places(edited: Edited, model: Model, group: Group, changed: WeatheredMaterial, textures: Textures) -> _Places:
    """The group's own UVs if they can hold a layer, else a new set.

    Raises:
        ChartsError: the charts of a new set do not fit the largest size.
    """
    own = group.uv(changed.uv_set())
    positions = model.mesh.positions[model.mesh.faces[group.faces]]
    flaw = uv_fitness(positions, own).reason or _border_flaw(own, changed)
    share = float(model.areas[group.faces].sum() / model.areas.sum())
    enough = textures.size or enough_texels(share, textures.painted)
    rows, cols = changed.size(textures.size) or (enough, enough)
    if own is not None and not flaw:
        return _Places(Canvas(model, group.faces, wrapped(own)), rows, cols)
    wanted = textures.size or max(rows, cols, enough)  # a palette's own size says nothing
    uv, size = fitting_uv_set(positions, own, wanted)
    number = free_uv_set(group.asset, group.pieces)
    edited.told.append(f"'{group.name}' gets a second UV set, TEXCOORD_{number}: {flaw}.")
    if size > wanted:
        edited.told.append(f"'{group.name}' gets textures of {size} texels a side: its charts do not fit {wanted}.")
    return _Places(Canvas(model, group.faces, uv), size, size, number)


def enough_texels(share: float, painted: int) -> int:
    """The size at which a texture over a share of the model is as fine as the layer, where no texture of the file says
    how fine it should be.
    """
    side = painted * float(np.sqrt(share))
    return int(min(max(2 ** np.ceil(np.log2(max(side, 1.0))), _LEAST_SIZE), DEFAULT_SIZE))


def _border_flaw(own: Float[ndarray, "faces 3 2"] | None, changed: WeatheredMaterial) -> str:
    """What is wrong with UVs that leave the texture, although it does not repeat; empty if nothing is."""
    inside = own is None or (own.min() >= -_BEYOND and own.max() <= 1.0 + _BEYOND)
    return "" if inside or changed.repeats() else "they leave the texture, which does not repeat"
