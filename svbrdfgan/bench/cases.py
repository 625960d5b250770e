"""What is measured: pictures of one size each, and those that differ from the standard scene along one axis."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

STANDARD = "standard"

_FACTORS: Mapping[str, tuple[float, ...]] = MappingProxyType(
    {
        "vertices": (1 / 100, 1 / 10, 1, 4),
        "pixels": (1 / 4, 1 / 2, 1, 2, 4),
        "spp": (1 / 16, 1 / 4, 1, 4, 16),
        "batch": (1, 4, 16, 64),
    }
)
"""Of the case that the axes cross in. The last of each is left out on a CPU, where it takes minutes."""


@dataclass(frozen=True)
class Case:
    """One amount of work.

    Attributes:
        scene: "standard", or the name of a mesh.
        vertices: of the standard scene, about; a mesh has what it has, and None here.
        pixels: along each side of the picture.
        spp: samples per pixel.
        batch: pictures at once.
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
