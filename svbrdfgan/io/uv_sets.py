"""The UVs at which glTF's textures are looked up: which coordinates, and how KHR_texture_transform moves them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray


@dataclass(frozen=True)
class UVSet:
    """The texture coordinates of one texture of a material, as a file describes them.

    Attributes:
        number: of the attribute TEXCOORD_n.
        scale, rotation, offset: applied to u and v in this order; the rotation in radians.
    """

    number: int = 0
    scale: tuple[float, float] = (1.0, 1.0)
    rotation: float = 0.0
    offset: tuple[float, float] = (0.0, 0.0)

    @classmethod
    def of(cls, texture: dict[str, Any]) -> UVSet:
        """The set of glTF's `textureInfo`, whose KHR_texture_transform may name another set."""
        moved = texture.get("extensions", {}).get("KHR_texture_transform", {})
        (across, up), (right, down) = moved.get("scale", (1, 1)), moved.get("offset", (0, 0))
        return cls(
            int(moved.get("texCoord", texture.get("texCoord", 0))),
            (float(across), float(up)),
            float(moved.get("rotation", 0.0)),
            (float(right), float(down)),
        )

    def moved(self, uv: Float[ndarray, "vertices 2"]) -> Float[ndarray, "vertices 2"]:
        """The set's coordinates, scaled, turned and moved. Origins are at the lower left, and glTF's at the upper."""
        u, v = (uv * (1.0, -1.0) + (0.0, 1.0)).T * np.array(self.scale)[:, None]
        sine, cosine = math.sin(self.rotation), math.cos(self.rotation)
        turned = np.stack([cosine * u + sine * v, cosine * v - sine * u], axis=-1) + self.offset
        return turned * (1.0, -1.0) + (0.0, 1.0)
