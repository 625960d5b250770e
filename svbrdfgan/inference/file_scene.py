"""A mesh as its file shows it, for renderers: its own UVs, and its materials as they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.geometry.split import surface_over
from svbrdfgan.rendering.compositing import BARE, bare_maps
from svbrdfgan.types import FileMap, Material, Materials, Mesh, Part, Surface


def file_scene(mesh: Mesh) -> tuple[Surface, Materials]:
    """The surface over the UVs of each part's base colour, and the parts' materials.

    Maps that a file looks up elsewhere are constants: their mean. Parts without gloss are matt.
    """
    uv, parts, materials = np.zeros((len(mesh.faces), 3, 2)), [], []
    for number, part in enumerate(mesh.parts):
        own = _uv_set(part)
        corners = mesh.uv_set(own)
        if corners is not None:
            uv[mesh.face_part == number] = corners[mesh.face_part == number]
        maps = {name: _values(given, own, name) for name, given in part.all_maps.items()}
        alpha = maps.pop("alpha", torch.ones(1)).clamp(0.0, 1.0)
        opacity = alpha[..., 0].numpy() if alpha.ndim == 3 else float(alpha)
        parts.append(replace(part, alpha=opacity))
        materials.append(Material(bare_maps(BARE) | maps))
    surface = surface_over(replace(mesh, parts=tuple(parts)), uv)
    return replace(surface, repeat=(True, True)), Materials(tuple(materials))


def _uv_set(part: Part) -> int:
    """Where the first textured map of a part is looked up, base colour before others."""
    return next((given.uv_set for given in part.all_maps.values() if given.texture is not None), 0)


def _values(given: FileMap, own: int, name: str) -> Float[Tensor, "*shape"]:
    value = torch.tensor(given.factor, dtype=torch.float32)
    if given.texture is not None and given.uv_set == own:
        value = value * torch.from_numpy(given.texture).float()
    elif given.texture is not None and name != "normal":
        value = value * torch.from_numpy(given.texture).float().mean(dim=(0, 1))
    elif name == "normal":
        value = torch.tensor([0.0, 0.0, 1.0])
    return value if given.cutoff is None else (value >= given.cutoff).float()
