"""Pictures without noise, by Intel's Open Image Denoise where it is installed (`svbrdfgan[pictures]`)."""

from __future__ import annotations

import importlib.util
import logging

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray
from torch import Tensor

from svbrdfgan.geometry.camera_hits import CameraHits, camera_hits
from svbrdfgan.geometry.texels import sample_texture
from svbrdfgan.types import Camera, Materials, Surface

_PER_PIXEL = 2  # points of a guide along each side of a pixel
_BAND = 60  # rows that are looked at together, since each point takes memory

log = logging.getLogger(__name__)


def can_denoise() -> bool:
    """Whether the denoiser is installed."""
    return importlib.util.find_spec("pyoidn") is not None


def denoised(
    image: Float[Tensor, "height width 3"], surface: Surface, materials: Materials, camera: Camera
) -> Float[Tensor, "height width 3"]:
    """The linear picture of a surface without its noise, guided by base colours and normals; on the CPU.

    If the denoiser fails, its message is logged, and the picture comes back as it was.
    """
    color = np.ascontiguousarray(image.cpu().numpy(), dtype=np.float32)
    albedo, normal = guides(surface, materials, camera, *image.shape[:2])
    try:
        import pyoidn

        return torch.from_numpy(pyoidn.denoise(color, albedo=albedo, normal=normal, hdr=True))
    except (ImportError, OSError, RuntimeError) as error:
        log.warning("the picture keeps its noise, since Open Image Denoise does not work here: %s", error)
        return image.cpu()


def guides(
    surface: Surface, materials: Materials, camera: Camera, height: int, width: int
) -> tuple[Float[ndarray, "height width 3"], Float[ndarray, "height width 3"]]:
    """Base colours and shading normals in a picture, smooth at edges; zero where there is no surface."""
    bands = []
    for top in range(0, height, _BAND):
        rows = range(top, min(top + _BAND, height))
        hits = camera_hits(surface, camera, width, height, _PER_PIXEL, rows)
        fine = np.concatenate([_base_colors(hits, materials), hits.normals()], axis=-1)
        bands.append(fine.reshape(len(rows), _PER_PIXEL, width, _PER_PIXEL, 6).mean(axis=(1, 3)))
    color, normal = np.split(np.concatenate(bands).astype(np.float32), 2, axis=-1)
    return np.ascontiguousarray(color), np.ascontiguousarray(normal)


def _base_colors(hits: CameraHits, materials: Materials) -> Float[ndarray, "rows cols 3"]:
    """The base colour at each hit; zero where there is none."""
    colors, uv, surface = np.zeros((*hits.face.shape, 3), np.float32), hits.interpolate(hits.surface.uv), hits.surface
    for number, material in enumerate(materials.parts):
        mine, value = hits.part == number, material.base_color.cpu()
        if value.ndim == 3:
            value = sample_texture(value, torch.from_numpy(uv[mine]).float(), surface.repeat)
        colors[mine] = value.numpy()
    return colors.clip(0.0, 1.0)
