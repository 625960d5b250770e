"""Edit a document so that pieces of it weather: new textures for their materials, and nothing else."""

from __future__ import annotations

import copy
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from svbrdfgan.asset.asset import Asset
from svbrdfgan.asset.freed_places import take_freed_places
from svbrdfgan.asset.painted_texture import Canvas, paint_texture
from svbrdfgan.asset.painters import Painter
from svbrdfgan.asset.second_uv_set import second_uv_set
from svbrdfgan.asset.sheet import Sheet
from svbrdfgan.asset.uv_fitness import uv_fitness, wrapped
from svbrdfgan.asset.weathered_material import WeatheredMaterial
from svbrdfgan.io.gltf.accessors import append_accessor, read_accessor
from svbrdfgan.io.gltf.document import Document, Json
from svbrdfgan.io.gltf.materials import DocumentPictures
from svbrdfgan.io.gltf_codecs.plain import INDICES
from svbrdfgan.io.rows import merge_rows
from svbrdfgan.io.uv_sets import UVSet
from svbrdfgan.types import Mesh

DEFAULT_SIZE = 2048
"""Texels along a side for materials without a texture."""


@dataclass(frozen=True, eq=False)
class Model:
    """What a painter paints: the asset's mesh with its nose at +Z, and which faces are seen from behind."""

    mesh: Mesh
    reversed: Bool[ndarray, " faces"]


@dataclass(frozen=True)
class Textures:
    """How large textures are.

    Attributes:
        size: texels along the longer side of new textures; None keeps that of each material's own.
        painted: texels along a side of a texture over the whole model, by whose density the layer is painted.
    """

    size: int | None = None
    painted: int = 1024


@dataclass(eq=False)
class Edited:
    """A document under change.

    Attributes:
        told: one sentence for each thing that was done beyond new textures.
    """

    document: Document
    told: list[str] = field(default_factory=list)


def weather_document(
    asset: Asset, model: Model, painter: Painter, weathers: Collection[int], textures: Textures
) -> Edited:
    """The asset's document with a layer on the pieces of these numbers; the asset itself stays as it is."""
    edited = Edited(asset.document.copy())
    for group in _groups(asset, weathers):
        _weather_group(edited, asset, model, painter, group, textures)
    take_freed_places(edited.document, asset.document)
    return edited


@dataclass(frozen=True, eq=False)
class _Group:
    """The weathered pieces of one material: by number, their faces in the mesh, and whether others share it."""

    material: int | None
    pieces: tuple[int, ...]
    faces: Int[ndarray, " faces"]
    shared: bool


def _groups(asset: Asset, weathers: Collection[int]) -> Iterator[_Group]:
    of_material: dict[int | None, list[int]] = {}
    for piece in range(len(asset.pieces)):
        of_material.setdefault(asset.primitive(piece).get("material"), []).append(piece)
    for material, pieces in of_material.items():
        chosen = tuple(piece for piece in pieces if piece in weathers and asset.source(piece).instance == 0)
        faces = np.flatnonzero(np.isin(asset.face_piece, chosen))
        if len(faces):
            others = (piece for piece in range(len(asset.pieces)) if piece not in weathers)
            shared = any(_shows(asset.primitive(piece), material) for piece in others)
            yield _Group(material, chosen, faces, shared and material is not None)


def _shows(primitive: Json, material: int | None) -> bool:
    """Whether a primitive has the material, or one of its variants does."""
    return material in (primitive.get("material"), *(mapping["material"] for mapping in _variants(primitive)))


def _variants(primitive: Json) -> list[Json]:
    found: list[Json] = primitive.get("extensions", {}).get("KHR_materials_variants", {}).get("mappings", [])
    return found


def _weather_group(
    edited: Edited, asset: Asset, model: Model, painter: Painter, group: _Group, textures: Textures
) -> None:
    document, name = edited.document, _name(asset, group)
    material: Json = {"name": name} if group.material is None else asset.document.table("materials")[group.material]
    changed = WeatheredMaterial(document, copy.deepcopy(material), DocumentPictures(asset.document))
    uv_set = changed.uv_set()
    own = _corner_uv(asset, group, uv_set)
    positions = model.mesh.positions[model.mesh.faces[group.faces]]
    fitness = uv_fitness(positions, own)
    rows, cols = changed.size(textures.size) or (textures.size or DEFAULT_SIZE,) * 2
    number = None
    if fitness.fits and own is not None:
        uv = wrapped(own)
    else:
        rows = cols = textures.size or max(rows, cols, DEFAULT_SIZE)  # a palette's own size says nothing
        uv = second_uv_set(positions, own, rows)
        number = _free_number(asset, group)
        edited.told.append(f"'{name}' gets a second UV set, TEXCOORD_{number}: {fitness.reason}.")
    canvas = Canvas(model.mesh, group.faces, uv, model.reversed)
    scale = _painted_scale(canvas, textures.painted, rows, cols)
    painted = paint_texture(canvas, painter, rows // scale, cols // scale)
    sheet = Sheet(
        canvas,
        rows,
        cols,
        uv_set if number is None else None,
        lambda info: _corner_uv(asset, group, UVSet.of(info)),
        changed.pictures,
    )
    changed.weather(sheet, painted, number)
    _assign(edited, asset, group, changed.material, None if number is None else (number, uv))


def _name(asset: Asset, group: _Group) -> str:
    return asset.pieces[group.pieces[0]].part.name


def _painted_scale(canvas: Canvas, painted: int, rows: int, cols: int) -> int:
    """The power of two by which the layer is painted coarser than the texture, nearest to the density asked for."""
    corners = canvas.mesh.positions[canvas.mesh.faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2.0
    coarsest, scale = float(np.sqrt(2.0 * area)) / painted, 1
    while scale < 64 and canvas.texel(rows // (2 * scale), cols // (2 * scale)) <= coarsest:
        scale *= 2
    return scale


def _corner_uv(asset: Asset, group: _Group, uv_set: UVSet) -> Float[ndarray, "faces 3 2"] | None:
    """The UVs at the corners of a group's faces; None if one of its pieces has none."""
    made = np.zeros((len(asset.mesh.faces), 3, 2))
    for piece in group.pieces:
        uv = asset.uv(piece, uv_set.number)
        if uv is None:
            return None
        mine = asset.face_piece == piece
        made[mine] = uv_set.moved(uv)[asset.corner_vertices[mine]]
    return made[group.faces]


def _free_number(asset: Asset, group: _Group) -> int:
    taken = [
        int(key.removeprefix("TEXCOORD_"))
        for piece in group.pieces
        for key in asset.primitive(piece)["attributes"]
        if key.startswith("TEXCOORD_")
    ]
    return max(taken, default=-1) + 1


def _assign(edited: Edited, asset: Asset, group: _Group, material: Json, second: tuple[int, ndarray] | None) -> None:
    """Puts the material in place: of all pieces if all weather, else a copy of it, and of meshes that must differ."""
    document = edited.document
    if group.material is None or group.shared:
        if group.shared:
            edited.told.append(f"'{_name(asset, group)}' is copied: some of its parts are kept.")
            material = {**material, "name": f"{material.get('name', _name(asset, group))} weathered"}
        number = document.add("materials", material)
    else:
        number = group.material
        document.table("materials")[number] = material
    for piece in group.pieces:
        primitive = _own_primitive(edited, asset, piece, alone=second is None and number == group.material)
        primitive["material"] = number
        for mapping in _variants(primitive):
            if mapping["material"] == group.material:
                mapping["material"] = number
        if second is not None:
            mine = asset.face_piece[group.faces] == piece
            _add_uv(document, asset, piece, primitive, second[0], second[1][mine])


def _own_primitive(edited: Edited, asset: Asset, piece: int, *, alone: bool) -> Json:
    """The document's primitive of a piece; of a copy of its mesh, if other nodes show that mesh and must differ."""
    document, source = edited.document, asset.source(piece)
    node = document.table("nodes")[source.node]
    users = [number for number, other in enumerate(document.table("nodes")) if other.get("mesh") == node["mesh"]]
    if not alone and len(users) > 1:
        mesh = copy.deepcopy(document.table("meshes")[node["mesh"]])
        node["mesh"] = document.add("meshes", mesh)
        edited.told.append(f"'{mesh.get('name', 'a mesh')}' is copied for a node that must differ from others.")
    primitive: Json = document.table("meshes")[node["mesh"]]["primitives"][source.primitive]
    return primitive


def _add_uv(
    document: Document, asset: Asset, piece: int, primitive: Json, number: int, uv: Float[ndarray, "faces 3 2"]
) -> None:
    """Gives a primitive a further UV set, for which vertices are split; all its other arrays are gathered anew."""
    mine = asset.face_piece == piece
    vertex = asset.corner_vertices[mine].reshape(-1)
    # glTF's origin is at the upper left
    rows, corner = merge_rows(np.column_stack([vertex, uv.reshape(-1, 2) * (1.0, -1.0) + (0.0, 1.0)]))
    source = rows[:, 0].astype(np.int64)
    primitive["attributes"] = _gathered(document, asset, primitive["attributes"], source)
    primitive["attributes"][f"TEXCOORD_{number}"] = append_accessor(document, rows[:, 1:].astype("<f4"))
    if "targets" in primitive:
        primitive["targets"] = [_gathered(document, asset, target, source) for target in primitive["targets"]]
    faces = corner.reshape(-1, 3)
    if asset.source(piece).mirrored:
        faces = faces[:, ::-1]
    primitive["indices"] = append_accessor(document, faces.reshape(-1).astype("<u4"), target=INDICES)
    primitive.pop("mode", None)


def _gathered(document: Document, asset: Asset, attributes: Json, source: Int[ndarray, " vertices"]) -> Json:
    made: dict[str, Any] = {}
    for name, index in attributes.items():
        entry = document.table("accessors")[index]
        values = read_accessor(document, index)[source]
        keys = {"normalized": True} if entry.get("normalized") else {}
        made[name] = append_accessor(document, values, bounds=name == "POSITION", **keys)
    return made
