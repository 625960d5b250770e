"""Environment maps in .hdr and .exr files. Row 0 is the zenith in the file and in memory."""

from __future__ import annotations

import logging
import os
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.errors import AssetError
from svbrdfgan.io.files import check_file
from svbrdfgan.io.image import FLOAT, load_image, save_image

log = logging.getLogger(__name__)


def load_environment(path: str | os.PathLike[str]) -> Float[Tensor, "rows cols 3"]:
    """Linear radiance of an equirectangular .hdr or .exr image, finite and not negative.

    Negative values become 0. Infinite values (suns beyond half precision) become the greatest finite value. Both log a
    warning.

    Raises:
        AssetError: the file cannot be read, contains NaN, or contains no finite value.
    """
    path = check_file(path, FLOAT, "environment")
    radiance = load_image(path)[..., :3]
    if radiance.isnan().any():
        texels = int(radiance.isnan().any(-1).sum())
        raise AssetError(f"{path} holds NaN in {texels} of its pixels; repair or re-export the environment.")
    if not radiance.isfinite().any():
        raise AssetError(f"{path} holds no finite value; repair or re-export the environment.")
    if radiance.shape[1] != 2 * radiance.shape[0]:
        log.warning("%s is %d x %d, not twice as wide as high: is it equirectangular?", path, *radiance.shape[1::-1])
    return _clean(path, radiance)


def save_environment(path: str | os.PathLike[str], radiance: Float[Tensor, "rows cols 3"]) -> None:
    """Writes linear radiance to .exr (exact) or .hdr (shared exponent, within 1 % of a pixel's greatest channel).

    Raises:
        AssetError: the suffix or the shape is wrong, or the file cannot be written.
    """
    if Path(path).suffix.lower() not in FLOAT:
        raise AssetError(f"{path} cannot hold an environment; use one of {', '.join(FLOAT)}.")
    if radiance.ndim != 3 or radiance.shape[2] != 3:
        raise AssetError(
            f"{path}: an environment of shape {tuple(radiance.shape)} cannot be saved; wanted (rows, cols, 3)."
        )
    save_image(path, radiance)


def _clean(path: Path, radiance: Float[Tensor, "rows cols 3"]) -> Float[Tensor, "rows cols 3"]:
    """The radiance with infinite and negative values replaced, as `load_environment` says."""
    infinite = radiance == torch.inf
    if infinite.any():
        brightest = radiance[~infinite].max()
        log.warning("%s holds %d infinite values; they became %g", path, int(infinite.sum()), float(brightest))
        radiance = torch.where(infinite, brightest, radiance)
    if (radiance < 0).any():
        log.warning("%s holds %d negative values; they became 0", path, int((radiance < 0).sum()))
    return radiance.clamp(min=0.0).contiguous()
