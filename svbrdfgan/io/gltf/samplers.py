"""How glTF's samplers look textures up: what lies beyond the border, and between texels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan.io.gltf.document import Document, Json

_NEAREST = 9728
_CLAMP, _MIRROR, _REPEAT = 33071, 33648, 10497


@dataclass(frozen=True)
class Sampler:
    """The sampler of a texture.

    Attributes:
        wrap: what lies beyond the border, along u and v: OpenGL enumerants.
        is_nearest: whether magnified texels are squares.
    """

    wrap: tuple[int, int] = (_REPEAT, _REPEAT)
    is_nearest: bool = False

    @classmethod
    def of(cls, document: Document, info: Json) -> Sampler:
        """The sampler of a `textureInfo`."""
        number = document.table("textures")[info["index"]].get("sampler")
        entry = {} if number is None else document.header["samplers"][number]
        wrap = entry.get("wrapS", _REPEAT), entry.get("wrapT", _REPEAT)
        return cls(wrap, entry.get("magFilter") == _NEAREST)

    @property
    def repeat(self) -> tuple[bool, bool]:
        """Whether the texture repeats along u and v."""
        return self.wrap[0] == _REPEAT, self.wrap[1] == _REPEAT

    def inside(self, uv: Float[ndarray, "points 2"], rows: int, cols: int) -> Float[ndarray, "points 2"]:
        """UVs at which a bilinear lookup that repeats or clamps finds what the sampler shows of a texture."""
        mirrored = 1.0 - np.abs(1.0 - np.mod(uv, 2.0))
        uv = np.where([wrap == _MIRROR for wrap in self.wrap], mirrored, uv)
        return (np.floor(uv * (cols, rows)) + 0.5) / (cols, rows) if self.is_nearest else uv
