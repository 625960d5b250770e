"""A material's maps under weathering, row band by row band, as bytes that textures store."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch
from jaxtyping import Float, UInt8
from numpy import ndarray
from torch.nn.functional import interpolate

from svbrdfgan.asset.painted_texture import ALPHA, COLOR, METALLIC, NORMAL, ROUGHNESS
from svbrdfgan.geometry.normals import unit
from svbrdfgan.io.image import linear_from_srgb, srgb_from_linear

Bytes = UInt8[ndarray, "rows cols channels"]
Layer = Float[ndarray, "rows cols channels"]

_ROWS = 256

_DECODED = linear_from_srgb(torch.arange(256) / 255.0).numpy()


def layer_bands(painted: Layer, rows: int, cols: int) -> Iterator[tuple[slice, Layer]]:
    """A painted texture at another size, bilinear or averaged, in bands of rows; float32."""
    if painted.shape[:2] == (rows, cols):
        for first in range(0, rows, _ROWS):
            own = slice(first, min(first + _ROWS, rows))
            yield own, painted[own].astype(np.float32)
        return
    whole = torch.from_numpy(painted).permute(2, 0, 1)[None]
    step = max(1, rows // max(1, round(rows / _ROWS)))
    ratio = painted.shape[0] / rows
    for first in range(0, rows, step):
        own = slice(first, min(first + step, rows))
        low, high = int(np.floor(own.start * ratio)), int(np.ceil(own.stop * ratio))
        pad = (max(low - 2, 0), min(high + 2, painted.shape[0]))
        part = whole[:, :, pad[0] : pad[1]].float()
        tall = round((pad[1] - pad[0]) / ratio)
        mode = {"mode": "area"} if ratio > 1 else {"mode": "bilinear", "align_corners": False}
        resized = interpolate(part, (tall, cols), **mode)[0].permute(1, 2, 0).numpy()
        start = own.start - round(pad[0] / ratio)
        yield own, resized[start : start + own.stop - own.start]


def weathered_color(factor: Float[ndarray, " rgb"], base: Bytes, layer: Layer) -> Bytes:
    """Base colour under the layer, sRGB; bytes stay as they are where the layer is clear and nothing is multiplied.

    Args:
        factor: linear, baked into the texture.
    """
    linear, alpha = _DECODED[base[..., :3]] * factor.astype(np.float32), layer[..., ALPHA, None]
    made = _encoded(linear + alpha * (layer[..., COLOR] - linear))
    if (factor == 1.0).all():
        made = np.where(alpha > 0.0, made, base[..., :3])
    return made if base.shape[2] == 3 else np.concatenate([made, base[..., 3:]], axis=2)


def weathered_gloss(factors: tuple[float, float], base: Bytes, layer: Layer) -> Bytes:
    """Roughness in green and metallic in blue under the layer; red stays, which may hold occlusion."""
    alpha, made = layer[..., ALPHA], base[..., :3].copy()
    for channel, factor, number in ((1, factors[0], ROUGHNESS), (2, factors[1], METALLIC)):
        own = base[..., channel] * (factor / 255.0)
        made[..., channel] = _rounded(own + alpha * (layer[..., number] - own))
    return made


def weathered_normal(scale: float | None, base: Bytes, layer: Layer) -> Bytes:
    """Normals in tangent space under the layer; flat ones where the scale is None."""
    own = np.zeros((*layer.shape[:2], 3), np.float32)
    own[..., 2] = 1.0
    if scale is not None:
        own = unit((base[..., :3] / 127.5 - 1.0) * (scale, scale, 1.0))
    mixed = own + layer[..., ALPHA, None] * (layer[..., NORMAL] - own)
    return _rounded(0.5 + 0.5 * unit(mixed))


def covered(base: Bytes, layer: Layer) -> Bytes:
    """A texture of what lies under the dirt, such as emission: less by the layer's alpha."""
    made: Bytes = np.round(base[..., :3] * (1.0 - layer[..., ALPHA, None])).astype(np.uint8)
    return made


def _encoded(linear: Float[ndarray, "rows cols 3"]) -> Bytes:
    values = srgb_from_linear(torch.from_numpy(np.ascontiguousarray(linear)).clamp(0, 1))
    return (values * 255).round().byte().numpy()


def _rounded(values: Float[ndarray, "*shape"]) -> UInt8[ndarray, "*shape"]:
    return np.round(np.clip(values, 0.0, 1.0) * 255.0).astype(np.uint8)
