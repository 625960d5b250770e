"""All measures of one map."""

from __future__ import annotations

from dataclasses import dataclass

from svbrdfgan.metrics.uv.distortion import Distortion, distortion
from svbrdfgan.metrics.uv.layout import Layout, layout
from svbrdfgan.metrics.uv.neighbours import connectivity
from svbrdfgan.metrics.uv.visibility import VisibleSurface, visible_surface
from svbrdfgan.types import Surface


@dataclass(frozen=True)
class UVSummary:
    """The measures of a map, of what is seen from outside and not hidden.

    Attributes:
        connectivity: share of neighbouring places that stay neighbours in UV.
        kept: share of what is seen from outside that is not in a hidden part: what can be learned.
        seen: share of the whole surface's area that is seen from outside.
        area: of what is measured, square metres.
    """

    distortion: Distortion
    layout: Layout
    connectivity: float
    kept: float
    seen: float
    area: float

    @classmethod
    def of(cls, visible: VisibleSurface) -> UVSummary:
        """The measures of what is visible."""
        area = float(visible.areas.sum())
        return cls(distortion(visible), layout(visible), connectivity(visible), visible.kept, visible.seen, area)

    def flat(self) -> dict[str, float]:
        """All measures by name."""
        own = {name: getattr(self, name) for name in ("connectivity", "kept", "seen", "area")}
        return {**vars(self.distortion), **vars(self.layout), **own}


def summary_of(surface: Surface) -> UVSummary:
    """The measures of a surface, after `hide_inner_layers` where the embedding is not one-to-one. Some seconds."""
    return UVSummary.of(visible_surface(surface))
