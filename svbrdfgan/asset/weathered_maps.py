"""A material's maps under weathering, row band by row band, as bytes that textures store."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, UInt8
from numpy import ndarray
from torch.nn.functional import interpolate

from svbrdfgan.asset.painted_texture import ALPHA, COLOR, METALLIC, NORMAL, ROUGHNESS
from svbrdfgan.geometry.normals import unit
from svbrdfgan.io.image import linear_from_srgb, srgb_from_linear

Bytes = UInt8[ndarray, "rows cols 4"]
Layer = Float[ndarray, "rows cols channels"]
Factor = Float[ndarray, " channels"]
Paint = Callable[[Layer], Layer]

DIELECTRIC = 0.04
"""Reflectance of a dielectric at normal incidence."""

BAND = 256
"""Rows of new textures that are blended at a time."""

_DECODED = linear_from_srgb(torch.arange(256) / 255.0).numpy()


def layer_bands(painted: Layer, rows: int, cols: int) -> Iterator[tuple[slice, Layer]]:
    """A painted texture at another size, bilinear or averaged, in bands of rows; float32."""
    if painted.shape[:2] == (rows, cols):
        for first in range(0, rows, BAND):
            own = slice(first, min(first + BAND, rows))
            yield own, painted[own].astype(np.float32)
        return
    whole = torch.from_numpy(painted).permute(2, 0, 1)[None]
    step = max(1, rows // max(1, round(rows / BAND)))
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


def paint_color(layer: Layer) -> Layer:
    """Base colour of the layer, linear."""
    return layer[..., COLOR]


def paint_diffuse(layer: Layer) -> Layer:
    """Diffuse reflectance of the layer, which metals have none of; linear."""
    return layer[..., COLOR] * (1.0 - layer[..., METALLIC, None])


def paint_specular(layer: Layer) -> Layer:
    """Reflectance of the layer at normal incidence, linear."""
    metallic = layer[..., METALLIC, None]
    return DIELECTRIC * (1.0 - metallic) + metallic * layer[..., COLOR]


def weathered_color(factor: Factor, paint: Paint, base: Bytes, layer: Layer) -> Bytes:
    """Colour under the layer, sRGB; alpha stays, and so do bytes where the layer is clear and the factor 1.

    Args:
        factor: linear RGB, baked into the texture.
        paint: the layer's colour.
    """
    return _colored(base, _lerp(_linear(base) * factor, paint(layer), layer[..., ALPHA, None]))


def translucent_color(factor: Factor, paint: Paint, base: Bytes, layer: Layer) -> Bytes:
    """Colour and alpha under a layer that is opaque by itself: straight alpha, composited over.

    Args:
        factor: linear RGBA, baked into the texture.
    """
    own, cover = base[..., 3] * (factor[3] / 255.0), layer[..., ALPHA]
    alpha = own + cover * (1.0 - own)
    share = (cover / np.maximum(alpha, 1e-6))[..., None].astype(np.float32)
    made = _colored(base, _lerp(_linear(base) * factor[:3], paint(layer), share))
    made[..., 3] = _rounded(alpha)
    return made


def weathered_gloss(factors: tuple[float, float], metallic: bool, base: Bytes, layer: Layer) -> Bytes:
    """Roughness in green and metallic in blue under the layer; red stays, which may hold occlusion.

    Args:
        factors: of roughness and metallic, baked into the texture.
        metallic: whether the layer paints it.
    """
    made = base.copy()
    for channel, factor, number in ((1, factors[0], ROUGHNESS), (2, factors[1], METALLIC)):
        alpha = layer[..., ALPHA] * (number == ROUGHNESS or metallic)
        made[..., channel] = _rounded(_lerp(base[..., channel] * (factor / 255.0), layer[..., number], alpha))
    return made


def weathered_specular_gloss(factor: Factor, base: Bytes, layer: Layer) -> Bytes:
    """Specular colour, sRGB, and glossiness in alpha under the layer.

    Args:
        factor: specular, linear RGB, and glossiness.
    """
    made = weathered_color(factor[:3], paint_specular, base, layer)
    own = base[..., 3] * (factor[3] / 255.0)
    made[..., 3] = _rounded(_lerp(own, 1.0 - layer[..., ROUGHNESS], layer[..., ALPHA]))
    return made


def weathered_normal(scale: float | None, base: Bytes, layer: Layer) -> Bytes:
    """Normals in tangent space under the layer; flat ones where the scale is None."""
    own = np.zeros((*layer.shape[:2], 3), np.float32)
    own[..., 2] = 1.0
    if scale is not None:
        own = unit((base[..., :3] / 127.5 - 1.0) * (scale, scale, 1.0))
    made = base.copy()
    made[..., :3] = _rounded(0.5 + 0.5 * unit(_lerp(own, layer[..., NORMAL], layer[..., ALPHA, None])))
    return made


def weathered_channel(channel: int, factor: float, target: float, base: Bytes, layer: Layer) -> Bytes:
    """One channel of linear numbers, times the factor, towards its value under the dirt; the others stay."""
    made = base.copy()
    made[..., channel] = _rounded(_lerp(base[..., channel] * (factor / 255.0), target, layer[..., ALPHA]))
    return made


def covered_color(base: Bytes, layer: Layer) -> Bytes:
    """Light from under the dirt, such as emission, sRGB: less by the layer's alpha, which is linear."""
    return _colored(base, _linear(base) * (1.0 - layer[..., ALPHA, None]))


def tinted(base: Bytes, color: Float[ndarray, "rows cols 4"]) -> Bytes:
    """Colour, sRGB, and alpha times linear RGBA."""
    made = _colored(base, _linear(base) * color[..., :3])
    made[..., 3] = _rounded(base[..., 3] * (color[..., 3] / 255.0))
    return made


def _lerp(own: Any, target: Any, share: Layer) -> Any:
    return own + share * (target - own)


def _linear(base: Bytes) -> Layer:
    return _DECODED[base[..., :3]]


def _colored(base: Bytes, linear: Layer) -> Bytes:
    """The bytes with another colour, encoded as sRGB."""
    values = srgb_from_linear(torch.from_numpy(np.ascontiguousarray(linear, np.float32)).clamp(0, 1))
    made = base.copy()
    made[..., :3] = (values * 255).round().byte().numpy()
    return made


def _rounded(values: Float[ndarray, "*shape"]) -> UInt8[ndarray, "*shape"]:
    return np.round(np.clip(values, 0.0, 1.0) * 255.0).astype(np.uint8)
