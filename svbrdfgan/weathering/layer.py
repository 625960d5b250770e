"""From a recipe's name and options to its RGBA layer over a surface's texels."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any, Protocol

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray
from torch import Tensor

from svbrdfgan.config.error_messages import did_you_mean
from svbrdfgan.config.models import build
from svbrdfgan.errors import ConfigError
from svbrdfgan.types import Surface
from svbrdfgan.types.material import CHANNELS
from svbrdfgan.weathering.recipes import RECIPES, Recipe, matter
from svbrdfgan.weathering.site import Site, survey


class TexelGeometry(Protocol):
    """What weathering needs of a geometry buffer: gutters filled, row 0 at v = 0."""

    @property
    def position(self) -> Float[ndarray | Tensor, "rows cols 3"]:
        """Metres, in the surface's coordinates."""
        ...

    @property
    def normal(self) -> Float[ndarray | Tensor, "rows cols 3"]:
        """Unit, outward."""
        ...


def weather(
    surface: Surface, buffer: TexelGeometry, recipe: Recipe, maps: Collection[str] = (), *, site: Site | None = None
) -> Float[Tensor, "rows cols channels"]:
    """The weathering layer over a buffer's texels: linear RGB, straight alpha, then these maps, in [0, 1], float32.

    A pure function, the same for a model of any size. Gutters go on smoothly where the buffer's do. Takes about
    two seconds at 256 x 256, most of it for visibility and curvature.

    Args:
        site: `find_site` of the same surface and buffer, where several layers are painted on them.

    Raises:
        ConfigError: the recipe has no values for one of the maps.
    """
    _require_maps(recipe, maps)
    rows, cols, _ = buffer.position.shape
    site = site or find_site(surface, buffer)
    painted = np.column_stack([recipe.paint(site), *(matter(recipe, site, name) for name in CHANNELS if name in maps)])
    return torch.from_numpy(painted.reshape(rows, cols, -1).astype(np.float32))


def find_site(surface: Surface, buffer: TexelGeometry) -> Site:
    """The geometry that recipes depend on, at each texel of the buffer, row by row."""
    position, normal = (np.asarray(values, np.float64).reshape(-1, 3) for values in (buffer.position, buffer.normal))
    return survey(surface, position, normal)


def recipe_from_options(name: str, options: Mapping[str, Any], maps: Collection[str] = ()) -> Recipe:
    """The recipe of that name, with these options in place of its defaults.

    Args:
        maps: what it will have to paint beside base_color.

    Raises:
        ConfigError: no such recipe, no such option, a wrong type, a value out of range, or a map that it cannot paint.
    """
    if name not in RECIPES:
        hint = did_you_mean(name, RECIPES) or "."
        raise ConfigError(f"weathering recipe {name!r} is unknown{hint} Known are {', '.join(RECIPES)}.")
    recipe = build(RECIPES[name], options, f"weathering {name}")
    _require_maps(recipe, maps)
    return recipe


def _require_maps(recipe: Recipe, maps: Collection[str]) -> None:
    for name in maps:
        if name not in recipe.matter:
            known = ", ".join(recipe.matter)
            raise ConfigError(
                f"weathering {type(recipe).__name__} has no values for {name}, only for {known}; "
                f"remove {name} from 'maps'."
            )
