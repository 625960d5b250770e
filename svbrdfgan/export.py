"""A weathered mesh as files that any viewer shows."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.compositing import RGBA
from svbrdfgan.data.subject import Subject
from svbrdfgan.io import linear_from_srgb, save_glb, save_texture
from svbrdfgan.types import Materials


def write_weathered(
    path: Path, subject: Subject, layer: Float[Tensor, "rows cols channels"], maps: Mapping[str, float] | None = None
) -> Path:
    """Writes the surface as GLB, its layer composited over the learnable parts, and the layer alone as PNG beside it.

    Roughness and metallic are in the GLB as well. Each becomes a PNG beside it too, `NAME.roughness.png` and so on,
    whose numbers are those of the map and not sRGB.

    Args:
        maps: those that the layer paints beside base_color, with what lies beneath it.

    Returns:
        The path of the layer's PNG, which holds its RGBA.

    Raises:
        AssetError: the layer has channels for other maps, or the disk refuses.
    """
    materials = subject.materials({}, layer, maps)
    colors = {part: material.base_color for part, material in enumerate(materials.parts)}
    textures = {part: color for part, color in colors.items() if color.ndim == 3}
    save_glb(path, subject.surface, textures, _gloss(subject, materials) if maps else {})
    for name in maps or {}:
        values = materials[subject.learnable[0]].maps[name]
        save_texture(path.with_suffix(f".{name}.png"), linear_from_srgb(values.clamp(0, 1)))
    alone = path.with_suffix(".layer.png")
    save_texture(alone, layer[..., :RGBA])
    return alone


def _gloss(subject: Subject, materials: Materials) -> dict[int, Float[Tensor, "rows cols 2"]]:
    """Roughness and metallic of the learnable parts, which share one layer: 1 and 0 where it does not paint them."""
    painted = materials[subject.learnable[0]].maps
    rough, metallic = painted.get("roughness"), painted.get("metallic")
    shape = next(values.shape for values in (rough, metallic) if values is not None)
    both = [torch.ones(shape) if rough is None else rough, torch.zeros(shape) if metallic is None else metallic]
    return dict.fromkeys(subject.learnable, torch.cat(both, dim=-1))
