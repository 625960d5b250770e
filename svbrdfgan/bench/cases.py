"""The cases that are measured: the standard scene, a vehicle, and cases that differ along one axis."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

STANDARD = "standard"
"""The name of the standard scene with base colours alone."""
GLOSSY = "standard, whole material"
"""The name of the standard scene with all maps."""
VERTICES = 1_000_000  # of the standard scene
PIXELS = 256  # along a side of its picture
TEXELS = 512  # along a side of its texture

_FACTORS: Mapping[str, tuple[float, ...]] = MappingProxyType(
    {
        "vertices": (1 / 100, 1 / 10, 1, 4),
        "pixels": (1 / 4, 1 / 2, 1, 2, 4),
        "spp": (1 / 16, 1 / 4, 1, 4, 16),
        "batch": (1, 4, 16, 64),
    }
)
"""Multiples of the value in the case through which the axes run. On a CPU the last takes minutes and is left out."""


@dataclass(frozen=True)
class Case:
    """An amount of work to measure.

    Attributes:
        scene: `STANDARD`, `GLOSSY`, or the name of a mesh.
        vertices: approximate number in the standard scene; None for a mesh.
        pixels: along each side of the picture.
        spp: samples per pixel.
        batch: pictures rendered together.
    """

    scene: str
    vertices: int | None
    pixels: int
    spp: int
    batch: int = 1


def axes(centre: Case, gpu: bool) -> dict[str, tuple[Case, ...]]:
    """Cases through `centre` along each axis, in ascending order."""
    return {axis: _along(axis, centre, factors if gpu else factors[:-1]) for axis, factors in _FACTORS.items()}


def _along(axis: str, centre: Case, factors: Iterable[float]) -> tuple[Case, ...]:
    values = sorted({max(1, round(factor * getattr(centre, axis))) for factor in factors})
    changes: list[dict[str, int]] = [{axis: value} for value in values]
    return tuple(replace(centre, **change) for change in changes)  # type: ignore[arg-type]
