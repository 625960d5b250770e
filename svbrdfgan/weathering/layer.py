"""Evaluate a weathering recipe at a surface's texels, and build recipes from names and options."""

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
    """The fields of a geometry buffer that weathering uses. Texels without surface are filled; row 0 is at v = 0."""

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
    """The weathering layer at a buffer's texels: linear RGB, straight alpha, then `maps`; float32.

    All values are in [0, 1], except x and y of a normal, which are in [-1, 1].

    It is deterministic and does not depend on the model's size. Texels outside the mask continue the layer as smoothly
    as the buffer's filled values do. It takes about two seconds at 256 x 256, mostly for visibility and curvature.

    Args:
        maps: names of further material maps to paint, such as "roughness"; channels follow the order of `CHANNELS`.
        site: result of `find_site` for the same surface and buffer; saves time if several layers are painted.

    Raises:
        ConfigError: the recipe has no values for one of the maps.
    """
    _require_maps(recipe, maps)
    rows, cols, _ = buffer.position.shape
    site = site or find_site(surface, buffer)
    painted = np.column_stack([recipe.paint(site), *(matter(recipe, site, name) for name in CHANNELS if name in maps)])
    return torch.from_numpy(painted.reshape(rows, cols, -1).astype(np.float32))


def find_site(surface: Surface, buffer: TexelGeometry) -> Site:
    """The geometry that recipes use, at each texel of the buffer, row by row."""
    position, normal = (np.asarray(values, np.float64).reshape(-1, 3) for values in (buffer.position, buffer.normal))
    return survey(surface, position, normal)


def recipe_from_options(name: str, options: Mapping[str, Any], maps: Collection[str] = ()) -> Recipe:
    """The recipe of that name; `options` override its defaults.

    Args:
        maps: names of the maps that the recipe must be able to paint besides base_color.

    Raises:
        ConfigError: the recipe or an option is unknown, a value has the wrong type or is out of range, or the recipe
            cannot paint one of the maps.
    """
    if name not in RECIPES:
        hint = did_you_mean(name, RECIPES) or "."
        raise ConfigError(f"weathering recipe {name!r} is unknown{hint} Known are {', '.join(RECIPES)}.")
    recipe = build(RECIPES[name], options, f"weathering {name}")
    _require_maps(recipe, maps)
    return recipe


def _require_maps(recipe: Recipe, maps: Collection[str]) -> None:
    for name in maps:
        if name not in recipe.matter and name != "normal":  # all matter is flat so far
            known = ", ".join((*recipe.matter, "normal"))
            raise ConfigError(
                f"weathering {type(recipe).__name__} has no values for {name}, only for {known}; "
                f"remove {name} from 'maps'."
            )
