"""The files of `svbrdfgan bake`: the geometry buffer, its previews, the mesh with new UVs, and measures."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.geometry.bake import GeometryBuffer, exposed_faces
from svbrdfgan.geometry.bake_materials import bake_base_color
from svbrdfgan.geometry.normals import face_areas
from svbrdfgan.geometry.rasterize import Fragments
from svbrdfgan.io.atomic import atomic_path
from svbrdfgan.io.exr import save_exr
from svbrdfgan.io.gltf.surface_files import save_glb
from svbrdfgan.io.image import save_texture
from svbrdfgan.types import Mesh


def write_bake(
    directory: str | os.PathLike[str], mesh: Mesh, fragments: Fragments, buffer: GeometryBuffer
) -> dict[str, float | int]:
    """Writes the geometry buffer (EXR), previews (PNG), the mesh with new UVs (GLB) and metrics; returns the metrics.

    Raises:
        AssetError: the folder or a file cannot be written.
    """
    folder = Path(directory)
    save_exr(folder / "geometry_buffer.exr", _channels(buffer), uv_map=True)
    low, high = buffer.bounds
    position = (buffer.position - low) / (high - low).clamp(min=1e-12)
    for name, values in (("position", position), ("normal", 0.5 + 0.5 * buffer.normal)):
        dark_outside = torch.where(buffer.mask[..., None], values, torch.tensor(0.1))
        save_texture(folder / f"{name}.png", dark_outside, "raw")
    base = bake_base_color(mesh, fragments)
    textures = {part: map_ for part, map_ in enumerate(base) if map_.ndim == 3}
    save_glb(folder / "surface.glb", fragments.surface, textures)
    metrics = bake_metrics(mesh, fragments, buffer)
    with atomic_path(folder / "metrics.json") as temporary:
        temporary.write_text(json.dumps(metrics, indent=2) + "\n")
    return metrics


def bake_metrics(mesh: Mesh, fragments: Fragments, buffer: GeometryBuffer) -> dict[str, float | int]:
    """Measures of the embedding: face counts, UV coverage, layers per texel, exposed and outermost area shares."""
    surface, layers = fragments.surface, fragments.layers
    raster = fragments.outermost()
    area, exposed = face_areas(surface.positions, surface.faces), exposed_faces(surface)
    outermost = np.isin(np.arange(len(area)), raster.face[raster.mask])
    return {
        "mesh_faces": len(mesh.faces),
        "surface_faces": len(surface.faces),
        "surface_vertices": len(surface.positions),
        "coverage": float(buffer.mask.double().mean()),
        "layers_mean": float(layers[raster.mask].mean()),
        "layers_max": int(layers.max()),
        "area_square_metres": float(area.sum()),
        "exposed_area_share": float(area[exposed].sum() / max(area.sum(), 1e-300)),
        "outermost_area_share": float(area[outermost].sum() / max(area.sum(), 1e-300)),
    }


def _channels(buffer: GeometryBuffer) -> dict[str, Float[Tensor, "rows cols"]]:
    channels = {f"position.{axis}": buffer.position[..., i] for i, axis in enumerate("XYZ")}
    channels |= {f"normal.{axis}": buffer.normal[..., i] for i, axis in enumerate("XYZ")}
    return channels | {"mask": buffer.mask.float(), "part": buffer.part.float(), "area": buffer.area}
