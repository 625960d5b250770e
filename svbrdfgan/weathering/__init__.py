"""Procedural weathering layers (dirt, dust, rust, chips) from geometry alone: the ground truth that a network learns.

    layer = weather(surface, buffer, recipe_from_options("road-dirt", {"amount": 0.7, "seed": 3}))

A fixed recipe is a function of position, normal, ambient-occlusion visibility and curvature. Lengths are relative to
the model's size.
"""

from svbrdfgan.weathering.layer import TexelGeometry, find_site, recipe_from_options, weather
from svbrdfgan.weathering.recipes import RECIPES, ChippedPaint, Coat, Dust, Recipe, RoadDirt, Rust
from svbrdfgan.weathering.site import Site

__all__ = [
    "RECIPES",
    "ChippedPaint",
    "Coat",
    "Dust",
    "Recipe",
    "RoadDirt",
    "Rust",
    "Site",
    "TexelGeometry",
    "find_site",
    "recipe_from_options",
    "weather",
]
