"""Evaluate a weathering recipe at a surface's texels, and build recipes from names and options."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.config.error_messages import did_you_mean
from svbrdfgan.config.models import build
from svbrdfgan.errors import ConfigError
from svbrdfgan.geometry.tangents import corner_tangents
from svbrdfgan.geometry.texels import nearest_texels
from svbrdfgan.types import CHANNELS, FURTHER_MAPS, Layer, Surface
from svbrdfgan.weathering.mesh_maps import TexelGeometry
from svbrdfgan.weathering.recipes import RECIPES, Recipe
from svbrdfgan.weathering.recipes.recipe import Directions
from svbrdfgan.weathering.site import Site
from svbrdfgan.weathering.survey import find_site


def weather(
    surface: Surface, buffer: TexelGeometry, recipe: Recipe, maps: Collection[str] = (), *, site: Site | None = None
) -> Layer:
    """The weathering layer at a buffer's texels, with `maps` besides base colour; float32.

    All values are in [0, 1], but those of `normal`, which are unit vectors in tangent space. The layer is deterministic
    and does not depend on the model's size. Texels outside the mask continue it as smoothly as the buffer's filled
    values do. A layer takes about two seconds at 256 x 256, mostly for visibility and curvature.

    Args:
        maps: names of further material maps to paint, such as "roughness", in any order.
        site: result of `find_site` for the same surface and buffer; saves time if several layers are painted.

    Raises:
        ConfigError: one of the maps is unknown.
    """
    _require_maps(maps)
    rows, cols, _ = buffer.position.shape
    site = site or find_site(surface, buffer)
    names = tuple(name for name in FURTHER_MAPS if name in maps)
    painted = _painted(recipe, site, names, _tangents(surface, buffer) if "normal" in names else ())
    return Layer(painted.view(rows, cols, -1).float(), names)


def _painted(
    recipe: Recipe, site: Site, maps: tuple[str, ...], tangents: tuple[Directions, ...]
) -> Float[Tensor, "texels channels"]:
    """The channels of a layer. Normals in tangent space are the slopes of the recipe's height.

    Differences between texels would jump at the seams of the UVs.
    """
    if tangents and recipe.relief:
        coat, (across, up) = recipe.paint_relief(site, *(tangent.to(site.normal) for tangent in tangents))
    else:
        coat, across, up = recipe.paint(site), *2 * [torch.zeros_like(site.height)]
    tilted = torch.stack([-recipe.relief * across, -recipe.relief * up, torch.ones_like(across)], dim=1)
    further = {"roughness": coat.roughness[:, None], "metallic": coat.metallic[:, None], "normal": tilted}
    further["normal"] = torch.nn.functional.normalize(tilted, dim=1)
    return torch.cat([coat.rgba, *(further[name] for name in maps)], dim=1)


def _tangents(surface: Surface, buffer: TexelGeometry) -> tuple[Directions, Directions]:
    """Unit tangents and bitangents at the texels, both reversed where the buffer's normal is the surface's reversed.

    There the surface is seen from behind, where renderers reverse the whole tilted normal.
    """
    face, weights = (np.asarray(values) for values in (buffer.face, buffer.barycentric))
    nearest = nearest_texels(face >= 0)
    normals = surface.normals[surface.faces]
    tangent, bitangent, normal = corner_tangents(surface).frames(
        normals, face[nearest].ravel(), weights[nearest].reshape(-1, 3)
    )
    outward = np.asarray(buffer.normal, np.float64).reshape(-1, 3)
    side = np.where((outward * normal).sum(axis=1, keepdims=True) < 0.0, -1.0, 1.0)
    return torch.from_numpy(side * tangent), torch.from_numpy(side * bitangent)


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
