"""Weathering recipes: each paints all material maps, texel by texel, from the geometry of a site.

A recipe works in metres: its patterns have the size that they have on a real vehicle, from a metre down to two
millimetres or what texels resolve. Matter that settles is a film, whose optical depth `amount` multiplies; what chips
or eats begins where a potential exceeds a threshold that falls as `amount` grows. So coverage never decreases with it.
"""

from collections.abc import Mapping
from types import MappingProxyType

from svbrdfgan.weathering.recipes.chipped_paint import ChippedPaint
from svbrdfgan.weathering.recipes.dust import Dust
from svbrdfgan.weathering.recipes.grime import Grime
from svbrdfgan.weathering.recipes.recipe import Coat, Recipe
from svbrdfgan.weathering.recipes.road_dirt import RoadDirt
from svbrdfgan.weathering.recipes.rust import Rust
from svbrdfgan.weathering.recipes.smooth import SmoothChips, SmoothDirt, SmoothDust, SmoothRust

RECIPES: Mapping[str, type[Recipe]] = MappingProxyType(
    {
        "road-dirt": RoadDirt,
        "dust": Dust,
        "rust": Rust,
        "chipped-paint": ChippedPaint,
        "grime": Grime,
        "smooth-dirt": SmoothDirt,
        "smooth-dust": SmoothDust,
        "smooth-rust": SmoothRust,
        "smooth-chips": SmoothChips,
    }
)
"""Recipe classes by their names in configuration files and on the command line."""

__all__ = ["RECIPES", "ChippedPaint", "Coat", "Dust", "Grime", "Recipe", "RoadDirt", "Rust"]
