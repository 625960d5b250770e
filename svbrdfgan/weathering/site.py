"""The geometry that weathering recipes use: place, normal, mesh maps and substance at each texel."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

_BLOCK = 32000
"""Texels: torch shares operations on 32,768 numbers or more among threads of its own, which get in the way of ours."""


@dataclass(frozen=True, eq=False)
class Site:
    """Geometry at each texel, independent of the model's location; float64 unless it was moved.

    Attributes:
        position: in lengths of the model; x (left) and z (nose) from the centre, y from the ground.
        height: height above the ground in heights of the model, 0 to 1.
        normal: unit normal, outward.
        visibility: ambient-occlusion visibility: 1 is unoccluded, 0 is enclosed.
        curvature: scaled mean curvature: positive on edges, negative in creases, about 1 at a right angle.
        convex, crease, border: distance to the nearest sharp edge of each kind, in metres; inf if none is near.
        substance: `Substance` of what lies under the texel.
        axles: z of the wheels, in the units of `position`.
        texel: the side of a texel, in the units of `position`: recipes paint nothing finer.
        length: metres to a length of the model.
        tall: metres from the ground to the roof.
        tangents: unit tangents and bitangents, along which normal maps of the relief go; None if there is no such map.
    """

    position: Float[Tensor, "texels 3"]
    height: Float[Tensor, " texels"]
    normal: Float[Tensor, "texels 3"]
    visibility: Float[Tensor, " texels"]
    curvature: Float[Tensor, " texels"]
    convex: Float[Tensor, " texels"]
    crease: Float[Tensor, " texels"]
    border: Float[Tensor, " texels"]
    substance: Int[Tensor, " texels"]
    axles: tuple[float, ...]
    texel: float
    length: float
    tall: float
    tangents: Float[Tensor, "texels 2 3"] | None = None

    def at(self, texels: Int[Tensor, " chosen"] | slice) -> Site:
        """The same site at some of its texels only: recipes paint each texel by itself."""
        return self._with({name: value[texels] for name, value in self._tensors().items()})

    def to(self, device: torch.device | str, dtype: torch.dtype = torch.float32) -> Site:
        """The same site elsewhere, in other floating-point numbers."""
        moved = {
            name: value.to(device, dtype if value.is_floating_point() else value.dtype)
            for name, value in self._tensors().items()
        }
        return self._with(moved)

    def blocks(self) -> Iterator[Site]:
        """The same site in parts, to be painted on a thread each; on a GPU it is one part."""
        count = len(self.height) if self.height.is_cuda else _BLOCK
        for start in range(0, len(self.height), max(count, 1)):
            yield self.at(slice(start, start + count))

    def _with(self, tensors: Mapping[str, Any]) -> Site:
        return replace(self, **tensors)

    def _tensors(self) -> dict[str, Tensor]:
        return {spec.name: value for spec in fields(self) if isinstance(value := getattr(self, spec.name), Tensor)}
