"""The floor of the studio, which has no horizon: unshadowed, it is as bright as what lies behind it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.procedural.sky import pixels, plane_radiance
from svbrdfgan.types import Environment, Material, Materials, Part, Surface

_REFLECTANCE = 0.6  # of the floor
_WHITE = 1.35  # radiance of a white thing that the light meter measures
_EXTENT = 100.0  # half the floor's side, in diagonals of the object's box
_GAP = 1e-4  # between object and floor, in the same unit
_SOLE = Material.lambertian((_REFLECTANCE,) * 3)


@dataclass(frozen=True, eq=False)
class Cove:
    """A light above a matt floor, at the exposure that shows white as white.

    Attributes:
        light: that from below the horizon is what the unshadowed floor reflects.
        floor: radiance of the unshadowed floor, which is that of the background, too.
    """

    light: Environment
    floor: Float[Tensor, " 3"]

    @classmethod
    def of(cls, radiance: Float[Tensor, "rows cols 3"], toward: tuple[float, float, float]) -> Cove:
        """The cove in this light. The light must not be black.

        Exposure is by an incident light meter in the object's place: its dome, turned `toward` the camera, weights
        light from an angle a by (1 + cos a) / 2.
        """
        direction, solid_angle = pixels(*radiance.shape[:2])
        values, above = radiance.cpu().double().numpy(), np.clip(direction[..., 1:2] * len(radiance) / 2.0 + 0.5, 0, 1)
        floor = _REFLECTANCE * plane_radiance(values, direction, solid_angle)
        values = above * values + (1.0 - above) * floor
        dome = (1.0 + direction @ np.asarray(toward))[..., None] / 2.0
        metered = float((values * dome * solid_angle).sum(axis=(0, 1)).mean() / np.pi)
        scale = _WHITE / metered
        return cls(Environment(torch.from_numpy(scale * values).float()), torch.from_numpy(scale * floor).float())


def on_floor(surface: Surface) -> Surface:
    """The surface, and as a last part the floor beneath it."""
    low, high = surface.positions.min(axis=0), surface.positions.max(axis=0)
    size = float(np.linalg.norm(high - low))
    corners = np.array([[-1.0, 0.0, -1.0], [-1.0, 0.0, 1.0], [1.0, 0.0, 1.0], [1.0, 0.0, -1.0]]) * _EXTENT * size
    corners += [(low[0] + high[0]) / 2.0, low[1] - _GAP * size, (low[2] + high[2]) / 2.0]
    first, faces = len(surface.positions), np.array([[0, 1, 2], [0, 2, 3]])
    names = {part.name for part in surface.parts}
    name = next(word for word in ("floor" + "_" * length for length in range(len(names) + 1)) if word not in names)
    return replace(
        surface,
        positions=np.concatenate([surface.positions, corners]),
        normals=np.concatenate([surface.normals, np.tile([0.0, 1.0, 0.0], (4, 1))]),
        uv=np.concatenate([surface.uv, np.zeros((4, 2))]),
        elevation=np.concatenate([surface.elevation, np.zeros(4)]),
        faces=np.concatenate([surface.faces, first + faces]),
        face_part=np.concatenate([surface.face_part, np.full(2, len(surface.parts))]),
        parts=(*surface.parts, Part(name)),
        source_face=np.concatenate([surface.source_face, np.zeros(2, dtype=np.int64)]),
        source_barycentric=np.concatenate([surface.source_barycentric, np.tile(np.eye(3), (2, 1, 1))]),
    )


def with_floor(materials: Materials) -> Materials:
    """The materials of `on_floor`'s surface."""
    return Materials((*materials.parts, _SOLE))


def floor_alone(materials: Materials) -> Materials:
    """Likewise, with all but the floor black, so that a picture has nothing but the floor and the shadows on it."""
    black = Material.lambertian((0.0, 0.0, 0.0))
    return Materials((*(black for _ in materials.parts), _SOLE))
