"""All measures of one map."""

from __future__ import annotations

from dataclasses import dataclass

from svbrdfgan.metrics.uv.distortion import Distortion, distortion
from svbrdfgan.metrics.uv.layout import Layout, layout
from svbrdfgan.metrics.uv.neighbours import connectivity
from svbrdfgan.metrics.uv.visibility import Outside, outside
from svbrdfgan.types import Surface


@dataclass(frozen=True)
class Card:
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

    def flat(self) -> dict[str, float]:
        """All measures by name."""
        own = {name: getattr(self, name) for name in ("connectivity", "kept", "seen", "area")}
        return {**vars(self.distortion), **vars(self.layout), **own}


def card_of(surface: Surface) -> Card:
    """The card of a surface, after `hide_inner_layers` where the embedding is not one-to-one. Some seconds."""
    return measure(outside(surface))


def measure(found: Outside) -> Card:
    """The card of what was found outside."""
    return Card(distortion(found), layout(found), connectivity(found), found.kept, found.seen, float(found.areas.sum()))
