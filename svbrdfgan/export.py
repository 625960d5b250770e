"""A weathered mesh as files that any viewer shows."""

from __future__ import annotations

from pathlib import Path

from jaxtyping import Float
from torch import Tensor

from svbrdfgan.compositing import composite
from svbrdfgan.data.subject import Subject
from svbrdfgan.io import save_glb, save_texture


def write_weathered(path: Path, subject: Subject, layer: Float[Tensor, "rows cols 4"]) -> Path:
    """Writes the surface as GLB, its layer composited over the learnable parts, and the layer alone as PNG beside it.

    Returns:
        The path of the PNG.
    """
    rows, cols = layer.shape[:2]
    textures: dict[int, Tensor] = {}
    for part, base in enumerate(subject.base):
        if part in subject.learnable:
            textures[part] = composite(base.expand(rows, cols, 3), layer)
        elif base.ndim == 3:
            textures[part] = base
    save_glb(path, subject.surface, textures)
    alone = path.with_suffix(".layer.png")
    save_texture(alone, layer)
    return alone
