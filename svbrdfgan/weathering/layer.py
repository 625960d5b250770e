"""Evaluate a weathering recipe at a surface's texels, and build recipes from names and options."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.config.error_messages import did_you_mean
from svbrdfgan.config.models import build
from svbrdfgan.errors import ConfigError
from svbrdfgan.types import CHANNELS, FURTHER_MAPS, Layer, Surface
from svbrdfgan.utils.threads import in_threads
from svbrdfgan.weathering.mesh_maps import TexelGeometry
from svbrdfgan.weathering.recipes import RECIPES, Recipe
from svbrdfgan.weathering.site import Site
from svbrdfgan.weathering.survey import find_site, texel_tangents


def weather(
    surface: Surface, buffer: TexelGeometry, recipe: Recipe, maps: Collection[str] = (), *, site: Site | None = None
) -> Layer:
    """The weathering layer at a buffer's texels, with `maps` besides base colour; float32, on the CPU.

    All values are in [0, 1], but those of `normal`, which are unit vectors in tangent space. The layer is deterministic
    and does not depend on the model's place. Texels outside the mask continue it as smoothly as the buffer's filled
    values do. Most of the time goes into the site; the recipe itself paints where that is, on a CPU or a GPU.

    Args:
        maps: names of further material maps to paint, such as "roughness", in any order.
        site: result of `find_site` for the same surface and buffer, best with tangents if `maps` has normals; saves
            time if several layers are painted.

    Raises:
        ConfigError: one of the maps is unknown.
    """
    _require_maps(maps)
    rows, cols, _ = buffer.position.shape
    names = tuple(name for name in FURTHER_MAPS if name in maps)
    site = site or find_site(surface, buffer)
    if "normal" in names and site.tangents is None:
        site = replace(site, tangents=texel_tangents(surface, buffer).to(site.normal))
    return Layer(painted(recipe, site, names).cpu().view(rows, cols, -1), names)


def painted(recipe: Recipe, site: Site, maps: tuple[str, ...]) -> Float[Tensor, "texels channels"]:
    """The channels of a layer, float32, where the site is; normals are flat if that has no tangents."""
    return torch.cat(list(in_threads(lambda block: _painted(recipe, block, maps), site.blocks())))


def _painted(recipe: Recipe, site: Site, maps: tuple[str, ...]) -> Float[Tensor, "texels channels"]:
    """The channels of some texels. Normals in tangent space are the slopes of the recipe's height.

    Differences between texels would jump at the seams of the UVs.
    """
    if "normal" in maps and recipe.relief and site.tangents is not None:
        coat, slopes = recipe.paint_relief(site, *site.tangents.unbind(dim=1))
    else:
        coat, slopes = recipe.paint(site), 2 * [torch.zeros_like(site.height)]
    tilted = torch.stack([*(-recipe.relief * slope for slope in slopes), torch.ones_like(slopes[0])], dim=1)
    further = {"roughness": coat.roughness[:, None], "metallic": coat.metallic[:, None]}
    further["normal"] = torch.nn.functional.normalize(tilted, dim=1)
    return torch.cat([coat.rgba, *(further[name] for name in maps)], dim=1).float()


def recipe_from_options(name: str, options: Mapping[str, Any], maps: Collection[str] = ()) -> Recipe:
    """The recipe of that name; `options` override its defaults.

    Args:
        maps: names of the maps that the recipe shall paint besides base_color.

    Raises:
        ConfigError: the recipe, an option or a map is unknown, or a value has the wrong type or is out of range.
    """
    if name not in RECIPES:
        hint = did_you_mean(name, RECIPES) or "."
        raise ConfigError(f"weathering recipe {name!r} is unknown{hint} Known are {', '.join(RECIPES)}.")
    _require_maps(maps)
    return build(RECIPES[name], options, f"weathering {name}")


def _require_maps(maps: Collection[str]) -> None:
    if unknown := [name for name in maps if name not in CHANNELS]:
        raise ConfigError(f"maps: {', '.join(unknown)} is unknown; known are {', '.join(CHANNELS)}.")
