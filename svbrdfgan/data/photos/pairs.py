"""What a second picture from the same tripod says: of the clean object, or without the flash that lights the first.

Both leave little to estimate. The paint of the clean object is known, so that its picture shows the shading of each
pixel. With a flash beside the lens, the difference of both pictures has the flash's light alone, whose shading is
known but for one factor: Lambert's cosine over the square of the distance. Petschnigg et al., Digital Photography with
Flash and No-Flash Image Pairs (2004); Eisemann & Durand, Flash Photography Enhancement (2004).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from svbrdfgan.data.photos.light import GLOSS
from svbrdfgan.data.reflectance_errors import MAX_REFLECTANCE
from svbrdfgan.geometry.camera_hits import CameraHits
from svbrdfgan.geometry.texels import nearest_texels
from svbrdfgan.types import Rendering

Image = Float[Tensor, "height width 3"]
Pixels = Bool[Tensor, "height width"]

_NOISE = 0.02
"""Standard deviations of what a picture, divided by the estimated light, has beyond shading and gloss,"""
_SHADE = 0.25
"""of shading over that in the estimated light,"""
_SHINE = 0.05
"""and of gloss."""
_LEAST = 0.1
"""Shading, over that in the estimated light."""
_STRONG = 0.1
"""Gloss, as a share of shading, that may be gone when the object is weathered."""
USUAL_ROUGHNESS = 0.35
"""Of paint whose gloss a flash shows."""
_FACING = 0.04
"""Reflectance of a smooth surface of paint that faces the light."""
_STRAIGHT, _GRAZING = 0.98, 0.15
"""Cosines between which a flash neither makes highlights nor leaves too little light."""


def divided(picture: Image, shading: Image) -> Image:
    """The reflectance that a picture shows under this shading, in [0, 1]; 0 where nothing is lit."""
    return (picture / torch.where(shading > 0, shading, torch.inf)).clamp(0, 1)


def shading_of_pair(before: Image, base: Image, estimated: Image) -> tuple[Image, Pixels]:
    """What a white object would look like in the light of a picture of the clean object, and where that is known.

    Shading changes how bright the known paint's colour is, and gloss adds the light's: their amounts in a pixel are
    fitted to all three channels by regularised least squares. Strong gloss is unknown, since weathering may take it
    away. Shafer, Using Color to Separate Reflection Components (1985).

    Args:
        before: the picture.
        base: the clean object's reflectance.
        estimated: what a white object looks like in the estimated light.
    """
    lit = (estimated > 0).all(dim=-1)
    seen = torch.where(lit.unsqueeze(-1), before / estimated, base)
    # the normal equations of seen = shade * base + gloss, both held to what the estimated light expects
    square, mean = (base * base).sum(dim=-1) + _NOISE**2 / _SHADE**2, base.sum(dim=-1)
    count = 3.0 + _NOISE**2 / _SHINE**2
    product = (seen * base).sum(dim=-1) + _NOISE**2 / _SHADE**2
    total = seen.sum(dim=-1) + GLOSS * _NOISE**2 / _SHINE**2
    determinant = square * count - mean * mean
    shade = ((product * count - mean * total) / determinant).clamp(min=_LEAST)
    gloss = (square * total - mean * product) / determinant
    return estimated * shade.unsqueeze(-1), lit & (gloss < _STRONG * shade)


def reflectance_of_pair(after: Image, before: Image, base: Image, shading: Image) -> Image:
    """The reflectance of the weathered object: that of the clean one, and what changed between the pictures."""
    dark = shading <= 0
    return torch.where(dark, base, base + (after - before) / shading.masked_fill(dark, 1.0)).clamp(0, MAX_REFLECTANCE)


@dataclass(frozen=True, eq=False)
class FlashShading:
    """What a flash beside the lens adds to a picture of a white matt object.

    Attributes:
        values: for a flash in whose light it would be 1 at a distance of 1, facing the flash.
        cosine: of the angle between normal and line of sight.
        clear: pixels without highlights and with enough light.
    """

    values: Float[Tensor, "height width"]
    cosine: Float[Tensor, "height width"]
    clear: Pixels

    @classmethod
    def of(cls, hits: CameraHits) -> FlashShading:
        """The shading of what a camera sees."""
        away = hits.origin - hits.interpolate(hits.surface.positions)
        distance = np.linalg.norm(away, axis=-1)
        cosine = (hits.normals() * away).sum(axis=-1) / np.maximum(distance, 1e-9)
        values = np.where(hits.hit, cosine.clip(min=0) / np.maximum(distance, 1e-9) ** 2, 0.0)
        clear = hits.hit & (cosine > _GRAZING) & (cosine < _STRAIGHT)
        return cls(torch.from_numpy(values).float(), torch.from_numpy(cosine).float(), torch.from_numpy(clear))

    def gloss(self, roughness: float) -> Float[Tensor, "height width 1"]:
        """The reflectance that gloss of paint of this roughness adds where `clear`, without its masking."""
        square, cosine = roughness**4, self.cosine.clamp(min=_GRAZING) ** 2
        lobe = square / (cosine * (square - 1.0) + 1.0) ** 2
        return (_FACING / 4.0 * lobe / cosine).unsqueeze(-1)

    def reflectance(self, picture: Image, power: Float[Tensor, " 3"]) -> Image:
        """The reflectance that a picture shows in the light of this flash alone; 0 where not `clear`.

        Args:
            power: the value of each channel in a picture of a white matt object at a distance of 1, which faces
                the flash.
        """
        lit = torch.where(self.clear, self.values, torch.inf).unsqueeze(-1) * power
        return (picture / lit - self.gloss(USUAL_ROUGHNESS)).clamp(0, MAX_REFLECTANCE)


def relit(reflectance: Image, known: Pixels, shading: Image, others: Rendering) -> Rendering:
    """The picture of an object of this reflectance in other light.

    Args:
        known: where the reflectance is known; other pixels have that of the nearest one that is.
        shading: of the learnable parts, painted white.
        others: the picture of all other parts.
    """
    row, col = nearest_texels(known.numpy())
    return Rendering(others.image + reflectance[row, col] * shading, others.coverage)
