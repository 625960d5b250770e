"""The four qualities of a UV embedding (thesis, section 4.1), measured on what is seen from outside.

`card_of(surface)` measures distortion, compactness, connectivity and what spoils a map; `similarity` compares two.
"""

from svbrdfgan.metrics.uv.distortion import Distortion, distortion, face_stretch, singular_values
from svbrdfgan.metrics.uv.layout import Layout, layout
from svbrdfgan.metrics.uv.neighbours import Similarity, connectivity, similarity
from svbrdfgan.metrics.uv.summary import Card, card_of, measure
from svbrdfgan.metrics.uv.visibility import Outside, outside, whole

__all__ = [
    "Card",
    "Distortion",
    "Layout",
    "Outside",
    "Similarity",
    "card_of",
    "connectivity",
    "distortion",
    "face_stretch",
    "layout",
    "measure",
    "outside",
    "similarity",
    "singular_values",
    "whole",
]
