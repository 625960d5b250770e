"""Parts that rays pass through by chance: whether a ray stops where it meets a face.

For each ray and each face a number is drawn and compared with alpha. The number is a function of the ray and the face,
because a search meets faces in any order; so the numbers that paths draw elsewhere are the same whether parts are
opaque.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from svbrdfgan.types import Part, Surface
from svbrdfgan_numpy.bvh import Stops
from svbrdfgan_numpy.textures import Texture


@dataclass(frozen=True, eq=False)
class RayNumbers:
    """The numbers that tell rays apart, so that each passes by its own chance.

    Attributes:
        seed: of the picture.
        stage: of the path: 0 from the camera, then one number for each of the two directions at each depth.
        path: the path of each ray, numbered over the whole picture.
    """

    seed: int
    stage: int
    path: Int[ndarray, " rays"]

    def draw(self, ray: Int[ndarray, " hits"], face: Int[ndarray, " hits"]) -> Float[ndarray, " hits"]:
        """A number in [0, 1) for each pair of a ray and a face."""
        bits = np.full(len(ray), self.seed % 2**64, dtype=np.uint64)
        for number in (np.full(len(ray), self.stage), self.path[ray], face):
            bits = _mixed(bits + _STEP * (number.astype(np.uint64) + _ONE))
        return (bits >> np.uint64(11)) * 2.0**-53  # 53 bits, as float64 holds, so that it stays below 1


@dataclass(frozen=True, eq=False)
class Transparency:
    """The alpha of a surface."""

    surface: Surface
    alpha: Texture

    @classmethod
    def of(cls, surface: Surface) -> Transparency | None:
        """The transparency of a surface; None if every part is opaque."""
        if all(part.opaque for part in surface.parts):
            return None
        maps = [_map(part) for part in surface.parts]
        texels = np.concatenate([values.reshape(-1, 1) for values in maps])
        return cls(surface, Texture(texels, tuple(torch.Size(values.shape) for values in maps), surface.repeat))

    def stops(self, rays: RayNumbers) -> Stops:
        """Whether these rays end where they meet faces: with the probability alpha."""

        def stop(
            ray: Int[ndarray, " hits"], face: Int[ndarray, " hits"], barycentric: Float[ndarray, "hits 2"]
        ) -> Bool[ndarray, " hits"]:
            weights = np.column_stack([1.0 - barycentric.sum(axis=1), barycentric])
            uv = np.einsum("hk,hkc->hc", weights, self.surface.uv[self.surface.faces[face]])
            alpha = self.alpha.taps(self.surface.face_part[face], uv).apply(self.alpha.texels)[:, 0]
            return np.asarray(rays.draw(ray, face) < alpha)

        return stop


_ONE = np.uint64(1)  # added to each number, since `_mixed` leaves 0 as it is
_STEP = np.uint64(0x9E3779B97F4A7C15)
"""The increment of SplitMix64: 2^64 over the golden ratio, made odd."""


def _map(part: Part) -> Float[ndarray, "*shape"]:
    """The part's alpha as a map of one channel, (1,) or (rows, cols, 1)."""
    return np.asarray(part.alpha, dtype=np.float64)[..., None]


def _mixed(bits: ndarray) -> ndarray:
    """Each bit of the result depends on all bits (the finaliser of SplitMix64, Steele et al. 2014, by Stafford)."""
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        bits = (bits ^ (bits >> np.uint64(shift))) * np.uint64(factor)
    return bits ^ (bits >> np.uint64(31))
