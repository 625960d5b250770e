"""Metrics for the four qualities of a UV embedding (thesis, section 4.1), on the surface visible from outside.

`UVSummary.of(visible_surface(surface))` measures distortion, compactness, connectivity, flips and overlaps;
`similarity` compares the maps of two surfaces.
"""
