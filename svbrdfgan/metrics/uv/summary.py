"""The summary of one map: all its measures."""

from __future__ import annotations

from dataclasses import dataclass

from svbrdfgan.metrics.uv.distortion import Distortion, distortion
from svbrdfgan.metrics.uv.layout import Layout, layout
from svbrdfgan.metrics.uv.neighbours import connectivity
from svbrdfgan.metrics.uv.visibility import VisibleSurface


@dataclass(frozen=True)
class UVSummary:
    """The measures of a map, on the surface that is visible from outside and not in hidden parts.

    Attributes:
        connectivity: share of neighbouring places that stay neighbours in UV.
        kept: share of the visible area that is not in a hidden part, and so can be learned.
        seen: share of the whole surface's area that is visible from outside.
        area: measured area, square metres.
    """

    distortion: Distortion
    layout: Layout
    connectivity: float
    kept: float
    seen: float
    area: float

    @classmethod
    def of(cls, visible: VisibleSurface) -> UVSummary:
        """The measures of a visible surface."""
        area = float(visible.areas.sum())
        return cls(distortion(visible), layout(visible), connectivity(visible), visible.kept, visible.seen, area)

    def flat(self) -> dict[str, float]:
        """The measures by name."""
        own = {name: getattr(self, name) for name in ("connectivity", "kept", "seen", "area")}
        return {**vars(self.distortion), **vars(self.layout), **own}
