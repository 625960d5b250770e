"""Metrics for the four qualities of a UV embedding (thesis, section 4.1), on the surface visible from outside.

`summary_of(surface)` measures distortion, compactness, connectivity, flips and overlaps; `similarity` compares the maps
of two surfaces.
"""

from svbrdfgan.metrics.uv.distortion import Distortion, distortion, face_stretch, singular_values
from svbrdfgan.metrics.uv.layout import Layout, layout
from svbrdfgan.metrics.uv.neighbours import Similarity, connectivity, similarity
from svbrdfgan.metrics.uv.summary import UVSummary, summary_of
from svbrdfgan.metrics.uv.visibility import VisibleSurface, visible_surface, whole_surface

__all__ = [
    "Distortion",
    "Layout",
    "Similarity",
    "UVSummary",
    "VisibleSurface",
    "connectivity",
    "distortion",
    "face_stretch",
    "layout",
    "similarity",
    "singular_values",
    "summary_of",
    "visible_surface",
    "whole_surface",
]
