"""The tone curve of pictures for people."""

from __future__ import annotations

from jaxtyping import Float
from torch import Tensor

_F0 = 0.04  # of a dielectric, taken off so that a base colour stays what it is
_SHOULDER = 0.8 - _F0  # where highlights begin to be compressed
_DESATURATION = 0.15


def neutral_tone(image: Float[Tensor, "height width 3"]) -> Float[Tensor, "height width 3"]:
    """Linear display values in [0, 1] of linear radiance, in which a base colour under even white light is itself.

    The curve is Khronos's PBR Neutral tone mapper (specification of 2024, Khronos Group, ToneMapping repository),
    which viewers of glTF share: below 0.8 only the reflectance of a dielectric is taken off; above it, the greatest
    channel approaches 1, and the colour approaches white.
    """
    least = image.amin(dim=-1, keepdim=True)
    color = image - (least - least.square() / (4.0 * _F0)).where(least < 2.0 * _F0, least.new_tensor(_F0))
    peak, room = color.amax(dim=-1, keepdim=True), 1.0 - _SHOULDER
    beyond = (peak - _SHOULDER).clamp(min=0.0)
    compressed = 1.0 - room * room / (beyond + room)
    gray = 1.0 - 1.0 / (_DESATURATION * (peak - compressed).clamp(min=0.0) + 1.0)
    bright = color * (compressed / peak.clamp(min=_SHOULDER))
    return color.where(peak < _SHOULDER, bright + gray * (compressed - bright)).clamp(0.0, 1.0)
