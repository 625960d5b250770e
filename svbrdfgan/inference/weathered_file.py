"""Weather a user's file: the scene that went in comes out, and only the materials that weather differ."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from svbrdfgan.asset.masks import MaskedPainter
from svbrdfgan.asset.overlay import Overlay, overlay_document
from svbrdfgan.asset.painted_texture import Model
from svbrdfgan.asset.painters import Painter
from svbrdfgan.asset.weather_document import Edited, Textures, weather_document
from svbrdfgan.inference.weatherings import RecipeWeathering, Weathering
from svbrdfgan.inference.workpiece import Workpiece, open_workpiece
from svbrdfgan.io.atomic import atomic_path
from svbrdfgan.io.eight_bit import png_bytes
from svbrdfgan.io.files import require_apart
from svbrdfgan.io.gltf.document import Document, picture_bytes, picture_type, write_document
from svbrdfgan.io.gltf.materials import images_of
from svbrdfgan.utils.display import Display
from svbrdfgan.weathering.recipes import Recipe

_MAPS = {
    "baseColorTexture": "base_color",
    "metallicRoughnessTexture": "metallic_roughness",
    "normalTexture": "normal",
    "emissiveTexture": "emissive",
    "diffuseTexture": "diffuse",
    "specularGlossinessTexture": "specular_glossiness",
}


@dataclass(frozen=True)
class Weathered:
    """What was written, and what the user should know.

    Attributes:
        paths: of the files, the scene first.
        told: sentences on what was done to the file beyond new textures.
        warnings: sentences on what the user should look at.
    """

    paths: tuple[Path, ...]
    told: tuple[str, ...]
    warnings: tuple[str, ...]


def write_weathered(
    path: str | os.PathLike[str],
    source: str | os.PathLike[str] | Workpiece,
    weathering: Weathering | Recipe,
    textures: Textures | None = None,
    *,
    learnable: Sequence[str] = (),
    keep: Sequence[str] = (),
    masks: Sequence[str] = (),
    front: str | None = None,
    up: str | None = None,
    length: float | None = None,
    variants: bool = False,
) -> Weathered:
    """Writes a mesh file's whole scene, weathered. All that does not weather stays as it was.

    Args:
        path: .glb, or .gltf with files beside it.
        source: .glb, .gltf, .obj, .ply or .stl; or what `open_workpiece` made of it, to which the patterns, masks, axes
            and length were given then, and on which nothing else weathers than its verdicts say.
        weathering: a recipe, or another kind of weathering.
        textures: how large; by default as the file's own.
        learnable, keep, masks, front, up, length: as for `open_workpiece`.
        variants: whether the clean materials are kept, too, as a variant.

    Raises:
        AssetError: a file cannot be read or written, or the result would overwrite the source.
        ConfigError: `front` or `up` is no axis, or a mask lies on nothing.
    """
    layer = weathering if isinstance(weathering, Weathering) else RecipeWeathering(weathering)
    if isinstance(source, Workpiece):
        workpiece = source
    else:
        opened = open_workpiece(source, learnable=learnable, keep=keep, masks=masks, front=front, up=up, length=length)
        workpiece = opened.settled(layer.settles_on)
    require_apart(workpiece.asset.path, Path(path))
    edited = weathered_document(workpiece, layer, textures or Textures(), variants=variants)
    return Weathered(tuple(write_document(path, edited.document)), tuple(edited.told), workpiece.warnings)


def weathered_document(
    workpiece: Workpiece,
    weathering: Weathering,
    textures: Textures,
    *,
    variants: bool = False,
    display: Display | None = None,
) -> Edited:
    """The workpiece's document with a layer on what weathers; as it was if that is nothing.

    Args:
        variants: as for `weather_document`.
    """
    asset = workpiece.asset
    if weathering.clean or not workpiece.weathered:
        return Edited.of(asset)
    model, painter = _model_and_painter(workpiece, weathering)
    edited = weather_document(asset, model, painter, workpiece.weathered, textures, variants=variants, display=display)
    return _signed(edited, weathering)


def overlaid_document(
    workpiece: Workpiece, weathering: Weathering, textures: Textures, *, display: Display | None = None
) -> Overlay:
    """The workpiece's document with a further UV set on what weathers, and a layer over it.

    Raises:
        AssetError: what weathers has too many charts for any texture, or xatlas is missing.
    """
    asset = workpiece.asset
    if not workpiece.weathered:
        return Overlay(Edited.of(asset), {})
    model, painter = _model_and_painter(workpiece, weathering)
    overlay = overlay_document(asset, model, painter, workpiece.weathered, textures, display=display)
    _signed(overlay.edited, weathering)
    return overlay


def write_maps(folder: Path, edited: Edited) -> list[Path]:
    """Writes the textures of the materials that weather, such as `paint.base_color.png`.

    Returns:
        The paths written.

    Raises:
        AssetError: a file cannot be written.
    """
    document = edited.document
    written: list[Path] = []
    for number in edited.materials:
        material = document.table("materials")[number]
        name = re.sub(r"[^\w.-]+", "_", str(material.get("name") or "material"))
        if any(path.name.startswith(f"{name}.") for path in written):
            name = f"{name}.{number}"
        for key, image in _images(document, material):
            data = picture_bytes(document, image)
            ending = picture_type(data).removeprefix("image/").replace("jpeg", "jpg")
            written.append(folder / f"{name}.{_MAPS[key]}.{ending}")
            with atomic_path(written[-1]) as temporary:
                temporary.write_bytes(data)
    return written


def write_layer(folder: Path, overlay: Overlay) -> list[Path]:
    """Writes an overlay's maps, such as `layer.base_color.png`.

    Returns:
        The paths written.

    Raises:
        AssetError: a file cannot be written.
    """
    written = []
    for name, texture in overlay.maps.items():
        written.append(folder / f"layer.{name}.png")
        with atomic_path(written[-1]) as temporary:
            temporary.write_bytes(png_bytes(texture))
    return written


def _model_and_painter(workpiece: Workpiece, weathering: Weathering) -> tuple[Model, Painter]:
    model = Model(workpiece.mesh, workpiece.surroundings.reversed)
    return model, MaskedPainter(weathering.painter(workpiece), workpiece.masks)


def _images(document: Document, entry: Any) -> Iterator[tuple[str, int]]:
    """The images of a material's weathered maps, each with the key of its `textureInfo`."""
    for key, value in entry.items() if isinstance(entry, dict) else ():
        if key in _MAPS and (images := images_of(document, value["index"])):
            yield key, images[0]
        elif key != "extras":
            yield from _images(document, value)


def _signed(edited: Edited, weathering: Weathering) -> Edited:
    """The same, whose asset's extras say what weathered it."""
    extras = edited.document.header["asset"].setdefault("extras", {})
    if isinstance(extras, dict):
        extras["svbrdfgan"] = {"version": version("svbrdfgan"), **weathering.description}
    return edited
