"""Write a surface under its materials over the UVs of its embedding as GLB, and the layer beside it as PNG."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import normalize

from svbrdfgan.geometry.tangents import corner_tangents
from svbrdfgan.io.gltf.surface_files import save_glb
from svbrdfgan.io.image import save_texture
from svbrdfgan.scene.subject import Subject
from svbrdfgan.types import Layer, Materials


def write_embedded(
    path: Path,
    subject: Subject,
    layer: Layer,
    maps: Mapping[str, float | None] | None = None,
) -> Path:
    """Writes the surface as GLB, with the layer composited over its learnable parts, and the layer as PNG next to it.

    The maps are in the GLB too, with tangents where there are normals; other parts keep those of the mesh's file, and
    its alpha. Each map also becomes a PNG, such as `NAME.roughness.png`, whose numbers are the map's own and not sRGB:
    `NAME.normal.png` holds 0.5 + 0.5 (x, y, z), +y upwards.

    Args:
        maps: as for `Subject.materials`.

    Returns:
        The path of the layer's PNG, which holds its RGBA.

    Raises:
        AssetError: the layer paints other maps, or a file cannot be written.
    """
    materials = subject.materials(layer, maps)
    further = save_materials(path, subject, materials)
    for name in layer.maps:
        values = further[subject.learnable[0]][name]
        numbers = 0.5 + 0.5 * values if name == "normal" else values
        save_texture(path.with_suffix(f".{name}.png"), numbers, "raw")
    layer_path = path.with_suffix(".layer.png")
    save_texture(layer_path, layer.rgba)
    return layer_path


def save_materials(path: Path, subject: Subject, materials: Materials) -> dict[int, dict[str, Float[Tensor, "*shape"]]]:
    """Writes the surface under these materials as GLB, and returns their further maps by part, normals of length one.

    Raises:
        AssetError: the file cannot be written.
    """
    colors = {part: material.base_color for part, material in enumerate(materials.parts)}
    textures = {part: color for part, color in colors.items() if color.ndim == 3}
    further = _further_maps(subject, materials)
    tangents = None
    if any("normal" in named for named in further.values()):
        tangents = corner_tangents(subject.surface).attribute()
    save_glb(path, subject.surface, textures, further, tangents)
    return further


def _further_maps(subject: Subject, materials: Materials) -> dict[int, dict[str, Float[Tensor, "*shape"]]]:
    """Roughness, metallic and unit normals by part. Learnable parts that have the same share their tensors."""
    further: dict[int, dict[str, Float[Tensor, "*shape"]]] = {}
    for part, material in enumerate(materials.parts):
        same = (k for k in subject.learnable if part in subject.learnable and k < part)
        if (first := next((k for k in same if _equal(materials[k].maps, material.maps)), None)) is not None:
            further[part] = further[first]
            continue
        further[part] = {name: values for name, values in material.maps.items() if name != "base_color"}
        if "normal" in further[part]:
            further[part]["normal"] = normalize(further[part]["normal"], dim=-1)
    return further


def _equal(one: Mapping[str, Tensor], other: Mapping[str, Tensor]) -> bool:
    """Whether both materials have the same maps apart from base_color."""
    names = one.keys() - {"base_color"}
    return names == other.keys() - {"base_color"} and all(torch.equal(one[name], other[name]) for name in names)
