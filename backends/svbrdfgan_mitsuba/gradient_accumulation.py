"""Gradients while they are summed."""

from __future__ import annotations

from collections.abc import Set
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from svbrdfgan.types import Environment, Gradients
from svbrdfgan_mitsuba.interop import tensor
from svbrdfgan_mitsuba.jit import dr
from svbrdfgan_mitsuba.textures import Maps


@dataclass(frozen=True, eq=False)
class Sums:
    """One for each texel of what is differentiated, float64; None for what is not.

    In float32 a constant's sum stands still after 2^24 equal additions.
    """

    mi: Any
    base_color: Any
    roughness: Any
    environment: Any

    @classmethod
    def of(cls, mi: Any, maps: Maps, environment: Environment, wrt: Set[str]) -> Sums:
        """Sums of nothing yet."""
        return cls(
            mi,
            maps.color.zeros(mi) if "base_color" in wrt else None,
            maps.rough.zeros(mi) if maps.rough and "roughness" in wrt else None,
            dr.zeros(mi.Float64, environment.radiance.numel()) if "environment" in wrt else None,
        )

    def gradients(self, maps: Maps, environment: torch.Size) -> Gradients:
        """The sums, shaped as the maps and the image that they belong to."""
        parts: list[dict[str, Tensor]] = [{} for _ in maps.color.shapes]
        for name, atlas, sums in (
            ("base_color", maps.color, self.base_color),
            ("roughness", maps.rough, self.roughness),
        ):
            for part, gradient in enumerate(atlas.split(sums) if atlas and sums is not None else ()):
                if gradient is not None:
                    parts[part][name] = gradient
        light = None if self.environment is None else tensor(self.mi.Float(self.environment)).view(environment)
        return Gradients(tuple(parts), light)


def leaf(value: Any, wanted: bool) -> Any:
    """The value, as the leaf of a new graph where its gradient is wanted."""
    if not wanted:
        return value
    detached = dr.detach(value)
    dr.enable_grad(detached)
    return detached
