"""The error of a map of a material against the true one, texel by texel."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

LEAST_ERRORS: Mapping[str, float] = MappingProxyType({"roughness": 1e-3, "metallic": 1e-3, "normal": 0.1})
"""Where the best constant is off by less, a map has nothing to learn and no `recovered`: metallic under dust."""


def map_error(
    name: str, made: Float[Tensor, "*size channels"], truth: Float[Tensor, "*size channels"]
) -> Float[Tensor, "*size"]:
    """The angle in degrees between two normals; of other maps, the mean absolute difference of the channels."""
    if name == "normal":
        return angle(made, truth)
    return (made - truth).abs().mean(dim=-1)


def angle(one: Float[Tensor, "*size 3"], other: Float[Tensor, "*size 3"]) -> Float[Tensor, "*size"]:
    """The angle in degrees between normals of any length; one of length zero counts as flat.

    It comes from sine and cosine, since the arc cosine alone has neither precision nor a gradient at small angles.
    """
    one, other = _directions(one), _directions(other)
    sine = torch.linalg.vector_norm(torch.linalg.cross(one, other), dim=-1)
    return torch.atan2(sine, (one * other).sum(dim=-1)) * (180.0 / math.pi)


def tilted(normal: Float[Tensor, "*size 3"], degrees: float) -> tuple[Float[Tensor, "*size 3"], ...]:
    """The directions of normals after turns by an angle towards two directions that are perpendicular to each other.

    Normals have z >= 0. The two directions are those of Duff et al., "Building an Orthonormal Basis, Revisited" (2017).
    """
    direction = _directions(normal)
    x, y, z = direction.unbind(dim=-1)
    k = -1.0 / (1.0 + z)
    towards = (torch.stack([1.0 + x * x * k, x * y * k, -x], dim=-1), torch.stack([x * y * k, 1 + y * y * k, -y], -1))
    turn = math.radians(degrees)
    return tuple(math.cos(turn) * direction + math.sin(turn) * tangent for tangent in towards)


def _directions(normal: Float[Tensor, "*size 3"]) -> Float[Tensor, "*size 3"]:
    flat = normal.new_tensor([0.0, 0.0, 1.0])
    return F.normalize(torch.where((normal == 0).all(dim=-1, keepdim=True), flat, normal), dim=-1)
