"""By how much the reflectance of an imported picture may be off: errors that fakes get, too, so that they tell nothing.

An import divides a picture by the light that it estimated. What is left is gain * reflectance + offset, seen a little
beside the place: the gain is true light over estimated light, the offset is gloss, the shift is the camera's error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float
from safetensors.torch import load_file, save
from torch import Tensor

from svbrdfgan.data.config import Split
from svbrdfgan.data.exemplar_files import exemplar_paths
from svbrdfgan.errors import AssetError
from svbrdfgan.io.atomic import atomic_path
from svbrdfgan.utils.copy_async import copy_async

MAX_REFLECTANCE = 1.5
"""Above 1, so that noise is not cut off on one side; bounded, since the discriminator sees the result."""
_CHANNELS = 8
"""Gain and offset of three channels each, and two of shift."""


@dataclass(frozen=True, eq=False)
class ReflectanceErrors:
    """Errors of exemplars, in half precision and main memory: a step needs few of them.

    Attributes:
        values: of each exemplar, some equally likely errors; in each pixel gain (3), offset (3), and the shift to where
            the picture shows what belongs there, in pixels to the right and down (2).
    """

    values: Float[Tensor, "exemplars draws height width 8"]

    def __post_init__(self) -> None:
        if self.values.ndim != 5 or self.values.shape[-1] != _CHANNELS or not self.values.shape[1]:
            raise AssetError(
                f"errors have shape {tuple(self.values.shape)}; wanted (exemplars, draws, height, width, 8)."
            )

    def drawn(
        self, indices: Sequence[int], rng: np.random.Generator, device: torch.device
    ) -> Float[Tensor, "batch height width 8"]:
        """One of the errors of each of these exemplars."""
        which = torch.from_numpy(rng.integers(self.values.shape[1], size=len(indices)))
        return copy_async(self.values[torch.as_tensor(list(indices)), which], device).float()


def with_errors(
    reflectance: Float[Tensor, "batch height width 3"], errors: Float[Tensor, "batch height width 8"]
) -> Float[Tensor, "batch height width 3"]:
    """The reflectance that an import with these errors would find; differentiable in the reflectance."""
    gain, offset, shift = errors.split((3, 3, 2), dim=-1)
    height, width = reflectance.shape[1:3]
    row, col = torch.meshgrid(
        torch.arange(height, device=errors.device), torch.arange(width, device=errors.device), indexing="ij"
    )
    place = torch.stack([col, row], dim=-1) + 0.5 + shift
    place = place * (2.0 / torch.tensor([width, height], device=errors.device)) - 1.0
    seen = F.grid_sample(reflectance.permute(0, 3, 1, 2), place, padding_mode="border", align_corners=False)
    return seen.permute(0, 2, 3, 1) * gain + offset


def no_errors(height: int, width: int) -> Float[Tensor, "height width 8"]:
    """The errors that change nothing."""
    return torch.tensor([1.0] * 3 + [0.0] * 5).expand(height, width, _CHANNELS).clone()


def mean_error(errors: Float[Tensor, "*shape 8"]) -> float:
    """The mean absolute logarithm of the gains."""
    return float(errors[..., :3].log().abs().mean())


def errors_path(folder: Path, split: Split, index: int) -> Path:
    """The file of an exemplar's errors."""
    return exemplar_paths(folder, split, index)[0].with_suffix(".errors.safetensors")


def save_errors(path: Path, values: Float[Tensor, "draws height width 8"]) -> None:
    """Writes an exemplar's errors in half precision."""
    with atomic_path(path) as temporary:
        temporary.write_bytes(save({"errors": values.half().contiguous()}))


def load_errors(folder: Path, split: Split, count: int) -> ReflectanceErrors | None:
    """The errors of a split's exemplars; None if the data set has none.

    Raises:
        AssetError: some of the files are missing or damaged.
    """
    paths = [errors_path(folder, split, number) for number in range(count)]
    if not any(path.is_file() for path in paths):
        return None
    try:
        return ReflectanceErrors(torch.stack([load_file(path)["errors"] for path in paths]))
    except (OSError, KeyError, ValueError, RuntimeError) as error:
        raise AssetError(f"errors of the {split} exemplars in {folder} cannot be read ({error}).") from error
