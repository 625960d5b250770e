"""The files of an exemplar: its picture, premultiplied linear radiance with coverage, and the scene that it shows."""

from __future__ import annotations

from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.data.config import Split
from svbrdfgan.errors import AssetError
from svbrdfgan.io.exr import load_exr, save_exr
from svbrdfgan.types import Rendering

BRIGHTEST = 60000.0
"""Stored pictures are clamped to this radiance, since half-precision floats end at 65504."""


def exemplar_paths(folder: Path, split: Split, index: int) -> tuple[Path, Path]:
    """The files of an exemplar's picture and scene. The scene is written last: it marks a whole picture."""
    stem = folder / split / f"{index:06d}"
    return stem.with_suffix(".exr"), stem.with_suffix(".json")


def save_exemplar(path: Path, rendering: Rendering) -> None:
    """Writes premultiplied linear radiance and coverage as a half-float RGBA picture."""
    red, green, blue = rendering.image.clamp(max=BRIGHTEST).unbind(-1)
    save_exr(path, {"R": red, "G": green, "B": blue, "A": rendering.coverage}, half=True)


def load_picture(path: Path) -> Float[Tensor, "height width 4"]:
    """An exemplar's picture as stored: premultiplied RGB and coverage, half precision."""
    channels = load_exr(path)
    try:
        return torch.stack([channels[name] for name in "RGBA"], dim=-1).half()
    except KeyError as error:
        raise AssetError(f"{path} has no channel {error}; it is not an exemplar's picture.") from error
