"""Files that cache subjects, their mesh maps, and layers."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.geometry.bake import GeometryBuffer
from svbrdfgan.io.tensors import save_tensors, stored_tensors
from svbrdfgan.scene.subject import Subject
from svbrdfgan.types import Layer, Part, Surface, layer_channels
from svbrdfgan.weathering.mesh_maps import MeshMaps

_SUBJECT = "svbrdfgan subject 2"
_LAYER = "svbrdfgan layer 2"
_MAPS = "svbrdfgan mesh maps 2"
_OF_PARTS = ("name", "base_color", "hidden_half_of")
_REMEDY = "delete it, and it is made again"


def save_subject(path: Path, subject: Subject, whole: Surface | None = None) -> None:
    """Writes a subject, so that no later process embeds and bakes its mesh again.

    Args:
        whole: for a window, the surface that it is a window of: what both share is left out.
    """
    surface, buffer, surface_parts = _tensors(subject.surface), _tensors(subject.buffer), subject.surface.parts
    if whole is not None:
        shared = _tensors(whole)
        surface = {name: own for name, own in surface.items() if name in shared and not torch.equal(own, shared[name])}
    tensors = {f"surface.{k}": v for k, v in surface.items()} | {f"buffer.{k}": v for k, v in buffer.items()}
    tensors |= {f"base.{part}": base for part, base in enumerate(subject.base)}
    for part, maps in enumerate(subject.file_maps):
        tensors |= {f"file.{part}.{name}": values for name, values in maps.items()}
    tensors |= {f"alpha.{k}": torch.as_tensor(part.alpha) for k, part in enumerate(surface_parts) if not part.opaque}
    parts = [{key: getattr(part, key) for key in _OF_PARTS} for part in surface_parts]
    header = {"learnable": subject.learnable, "parts": parts, "repeat": subject.surface.repeat}
    words = {"header": json.dumps(header | {"file_maps": bool(subject.file_maps)})}
    save_tensors(path, _SUBJECT, tensors, words)


def load_subject(path: Path, side: int, whole: Surface | None = None) -> Subject:
    """Reads what `save_subject` wrote. What the mesh's file says of parts is in `base`, `file_maps` and alpha alone.

    Args:
        side: rows and columns of its buffer.
        whole: for a window, the surface that it is a window of, whose arrays it then shares.

    Raises:
        AssetError: missing, damaged, or of another version or size.
    """
    with stored_tensors(path, _SUBJECT, _REMEDY) as (tensors, words):
        header = json.loads(words["header"])
        alphas = _under("alpha.", tensors)
        parts = tuple(
            Part(**p | {"base_color": tuple(p["base_color"])}, alpha=_alpha(alphas.get(str(k))))
            for k, p in enumerate(header["parts"])
        )
        shared = {} if whole is None else _arrays(whole)
        arrays = shared | {k: v.numpy() for k, v in _under("surface.", tensors).items()}
        whole_uv = None if whole is None else whole.uv
        surface = Surface(**arrays, parts=parts, repeat=tuple(header["repeat"]), whole_uv=whole_uv)
        buffer = GeometryBuffer(**_like(GeometryBuffer, _under("buffer.", tensors)))
        base = tuple(tensors[f"base.{part}"] for part in range(len(parts)))
        maps = [_under(f"file.{part}.", tensors) for part in range(len(parts))] if header.get("file_maps") else []
        subject = Subject(surface, buffer, tuple(header["learnable"]), base, tuple(maps))
        _require_whole(subject, side)
    return subject


def save_layer(path: Path, layer: Layer) -> None:
    """Writes a layer in single precision."""
    save_tensors(path, _LAYER, {"layer": layer.values.float()}, {"maps": json.dumps(layer.maps)})


def load_layer(path: Path, side: int) -> Layer:
    """Reads what `save_layer` wrote; with so many rows and columns.

    Raises:
        AssetError: missing, damaged, or of another version or size.
    """
    with stored_tensors(path, _LAYER, _REMEDY) as (tensors, words):
        layer = Layer(tensors["layer"], tuple(json.loads(words["maps"])))
        _require_texture("a layer", layer.values, (side, side, layer_channels(layer.maps)))
    return layer


def save_mesh_maps(path: Path, maps: MeshMaps) -> None:
    """Writes mesh maps, so that no later process bakes them again."""
    save_tensors(path, _MAPS, _tensors(maps), {})


def load_mesh_maps(path: Path, side: int) -> MeshMaps:
    """Reads what `save_mesh_maps` wrote; with so many rows and columns.

    Raises:
        AssetError: missing, damaged, or of another version or size.
    """
    with stored_tensors(path, _MAPS, _REMEDY) as (tensors, _):
        maps = MeshMaps(**tensors)
        for name, values in tensors.items():
            _require_texture(name, values, (side, side))
    return maps


def _require_whole(subject: Subject, side: int) -> None:
    """Checks what the surface does not: that the buffer, the learnable parts and the textures fit it.

    Raises:
        ValueError: something does not.
    """
    buffer, count = subject.buffer, len(subject.surface.parts)
    for name, axes in {"position": (3,), "normal": (3,), "barycentric": (3,), "area": ()}.items():
        _require_texture(name, getattr(buffer, name), (side, side, *axes))
    for name, most in {"part": count, "face": len(subject.surface.faces)}.items():
        values = getattr(buffer, name)
        if values.shape != (side, side) or values.is_floating_point() or values.min() < -1 or values.max() >= most:
            raise ValueError(f"the {name} of a texel is not one of {most}")
    learnable = subject.learnable
    if not {*learnable} <= {*range(count)} or len({*learnable}) < len(learnable):
        raise ValueError(f"its learnable parts are {learnable}; wanted some of {count}, each once")
    for values in (*subject.base, *(values for maps in subject.file_maps for values in maps.values())):
        _require_texture("a material", values, values.shape if values.ndim == 1 else (side, side, values.shape[-1]))


def _require_texture(name: str, values: Tensor, shape: tuple[int, ...]) -> None:
    """Checks that a tensor has this shape, and finite numbers.

    Raises:
        ValueError: it has not.
    """
    if values.shape != shape:
        raise ValueError(f"{name} has shape {tuple(values.shape)}")
    if not values.is_floating_point() or not values.isfinite().all():
        raise ValueError(f"{name} has values that are not finite numbers")


def _alpha(stored: Tensor | None) -> float | Float[np.ndarray, "rows cols"]:
    if stored is None:
        return 1.0
    return stored.numpy() if stored.ndim else float(stored)


def _tensors(record: Any) -> dict[str, Tensor]:
    """The arrays and tensors of a record, by field name."""
    return {name: torch.as_tensor(values) for name, values in _arrays(record).items()}


def _arrays(record: Any) -> dict[str, Any]:
    """The arrays and tensors of a record as they are, by field name."""
    values = {field.name: getattr(record, field.name) for field in fields(record)}
    return {name: value for name, value in values.items() if isinstance(value, np.ndarray | Tensor)}


def _under(prefix: str, tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    return {name.removeprefix(prefix): t for name, t in tensors.items() if name.startswith(prefix)}


def _like(record: type, tensors: Mapping[str, Tensor]) -> dict[str, Any]:
    """The tensors as the record declares them: as NumPy arrays where its annotation says ndarray."""
    wanted = {field.name: str(field.type) for field in fields(record)}
    return {name: t.numpy() if "ndarray" in wanted[name] else t for name, t in tensors.items()}
