"""The quantities compared: a picture and its derivatives, as sums over blocks, from one run of a renderer.

All terms of a sum have one sign, so that shares of the total and relative biases are meaningful.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray
from torch import Tensor

from svbrdfgan.geometry.texels import bilinear_taps
from svbrdfgan.rendering.checked_renderer import CheckedRenderer
from svbrdfgan.testing.pairs.pair_scene import TEXTURE, PairScene
from svbrdfgan.testing.statistics import numbers
from svbrdfgan.types import TransportSamples

BLOCKS = 4
"""The number of blocks along each side of the film, of each texture, and of the environment."""

_CELLS = BLOCKS * BLOCKS
_SIGNS = (1.0, -1.0, 1.0)  # of cotangents, by channel
_CHANNELS = 3


@dataclass(frozen=True, eq=False)
class RenderedScene:
    """A renderer with a scene prepared."""

    name: str
    renderer: CheckedRenderer
    prepared: Any
    scene: PairScene

    def gradients(self, cotangent: Float[Tensor, "height width 3"], spp: int, seed: int) -> Float[ndarray, "_ cells 3"]:
        """The gradient of base colour, summed over the blocks of the textures of each group of parts."""
        wrt = frozenset({"base_color"})
        scene, total = self.scene, np.zeros((self.scene.group_count, _CELLS, _CHANNELS))
        found = self.renderer.render_vjp(
            self.prepared, scene.materials, scene.view, cotangent, wrt=wrt, spp=spp, seed=seed
        )
        for group, maps in zip(scene.groups, found.materials, strict=True):
            total[group] += block_sums(maps["base_color"])
        return total


Measure = Callable[[RenderedScene, int, int], Float[ndarray, " blocks"]]


@dataclass(frozen=True)
class Quantity:
    """A picture or a derivative, in blocks.

    Attributes:
        measure: from a rendered scene, samples per pixel and seed to an unbiased estimate of every block.
        axes: what the blocks are of, outermost first, and how many of each; `groups` of parts are counted as 0.
        needs: what the renderer must differentiate; empty for the picture.
    """

    name: str
    measure: Measure
    axes: tuple[tuple[str, int], ...]
    needs: str = ""

    def shape(self, scene: PairScene) -> tuple[int, ...]:
        return tuple(count or scene.group_count for _, count in self.axes)

    def size(self, scene: PairScene) -> int:
        return int(np.prod(self.shape(scene)))

    def label(self, scene: PairScene, block: int) -> str:
        """The place of a block in words, such as "pixels 2,1 part 1 texels 0,3": rows and columns of blocks."""
        at = np.unravel_index(block, self.shape(scene))
        return " ".join(self.place(axis, int(index)) for axis, index in enumerate(at))

    def place(self, axis: int, index: int) -> str:
        """One axis of a label."""
        name = self.axes[axis][0]
        if name == "channel":
            return "RGB"[index]
        return f"part {index}" if name == "part" else f"{name} {index // BLOCKS},{index % BLOCKS}"


def offered(renderer: CheckedRenderer, quantity: Quantity) -> bool:
    """Whether the renderer can give the quantity."""
    return not quantity.needs or quantity.needs in renderer.capabilities.differentiable


def _image(rendered: RenderedScene, spp: int, seed: int) -> Float[ndarray, " blocks"]:
    scene = rendered.scene
    image = rendered.renderer.render(rendered.prepared, scene.materials, scene.view, spp=spp, seed=seed).image
    return block_sums(image).ravel()


def _gradient(rendered: RenderedScene, spp: int, seed: int) -> Float[ndarray, " blocks"]:
    return (rendered.gradients(cotangent(rendered.scene), spp, seed) * _SIGNS).ravel()


def _environment(rendered: RenderedScene, spp: int, seed: int) -> Float[ndarray, " blocks"]:
    scene, wrt = rendered.scene, frozenset({"environment"})
    found = rendered.renderer.render_vjp(
        rendered.prepared, scene.materials, scene.view, cotangent(scene), wrt=wrt, spp=spp, seed=seed
    )
    assert found.environment is not None, f"{rendered.name} declares environment gradients and gives none"
    return (block_sums(found.environment) * _SIGNS).ravel()


def _jacobian(rendered: RenderedScene, spp: int, seed: int) -> Float[ndarray, " blocks"]:
    lambertian = rendered.scene.maps == {"base_color"}  # what transport is made for
    if lambertian and rendered.renderer.capabilities.transport:
        return jacobian_of_transport(rendered, spp, seed).ravel()
    return jacobian_of_vjps(rendered, spp, seed).ravel()


def jacobian_of_transport(rendered: RenderedScene, spp: int, seed: int) -> Float[ndarray, "cells _ cells"]:
    """The Jacobian of the sum over each image block, in one channel, by the sum over each texel block, in the same.

    Image block i counts in channel i % 3: no renderer mixes channels, and so three blocks fit in one cotangent.
    """
    scene, groups = rendered.scene, torch.tensor(rendered.scene.groups)
    shape = (_CELLS, scene.group_count, _CELLS)
    total = np.zeros(int(np.prod(shape)))
    for samples in rendered.renderer.transport(rendered.prepared, scene.view, spp=spp, seed=seed):
        total += _binned(samples, scene, groups.to(samples.part.device), len(total))
    return total.reshape(shape)


def jacobian_of_vjps(rendered: RenderedScene, spp: int, seed: int) -> Float[ndarray, "cells _ cells"]:
    """The same by six gradients, of three image blocks each: for several bounces, other maps, or without transport."""
    scene = rendered.scene
    total = np.zeros((_CELLS, scene.group_count, _CELLS))
    block = torch.from_numpy(film_blocks(scene))
    for call, first in enumerate(range(0, _CELLS, _CHANNELS)):
        chosen = range(first, min(first + _CHANNELS, _CELLS))
        indicator = torch.zeros(*block.shape, _CHANNELS)
        for cell in chosen:
            indicator[..., cell % _CHANNELS][block == cell] = 1.0
        found = rendered.gradients(indicator, spp, seed * 8 + call)
        for cell in chosen:
            total[cell] = found[..., cell % _CHANNELS]
    return total


def _binned(samples: TransportSamples, scene: PairScene, groups: Tensor, bins: int) -> Float[ndarray, " bins"]:
    """The samples' weights in one channel, shared among the blocks of the texels that they look up."""
    device = samples.uv.device
    cell = torch.from_numpy(film_blocks(scene)).to(device).reshape(-1)[samples.pixel.long()]
    texel, tap = bilinear_taps(samples.uv, TEXTURE, TEXTURE, scene.surface.repeat)
    texel_cell = torch.from_numpy(block_index(TEXTURE, TEXTURE)).to(device).reshape(-1)[texel]
    key = ((cell * scene.group_count + groups[samples.part.long()]) * _CELLS).unsqueeze(1) + texel_cell
    weight = samples.weight.gather(1, (cell % _CHANNELS).unsqueeze(1)).double() * tap
    return numbers(torch.bincount(key.reshape(-1), weight.reshape(-1), minlength=bins))


def cotangent(scene: PairScene) -> Float[Tensor, "height width 3"]:
    """Random in size, from 0.5 to 1.5; of one sign in each channel, so that nothing cancels."""
    generator = torch.Generator().manual_seed(scene.view.width)
    size = 0.5 + torch.rand((scene.view.height, scene.view.width, _CHANNELS), generator=generator)
    return size * torch.tensor(_SIGNS)


def block_index(rows: int, cols: int) -> Int[ndarray, "rows cols"]:
    """The block, row * BLOCKS + column, in which each element lies."""
    row, col = (np.arange(count) * BLOCKS // count for count in (rows, cols))
    return row[:, None] * BLOCKS + col


def film_blocks(scene: PairScene) -> Int[ndarray, "height width"]:
    return block_index(scene.view.height, scene.view.width)


def block_sums(values: Float[Tensor, "rows cols channels"]) -> Float[ndarray, "cells channels"]:
    """The sum over each block, blocks row by row."""
    array = numbers(values)
    total = np.zeros((_CELLS, array.shape[2]))
    np.add.at(total, block_index(*array.shape[:2]).ravel(), array.reshape(-1, array.shape[2]))
    return total


# Axes of `Quantity`.
_PIXELS = ("pixels", _CELLS)
_TEXELS = ("texels", _CELLS)
_PART = ("part", 0)  # 0: as many as the scene has groups
_CHANNEL = ("channel", _CHANNELS)

QUANTITIES: Mapping[str, Quantity] = MappingProxyType(
    {
        quantity.name: quantity
        for quantity in (
            Quantity("image", _image, (_PIXELS, _CHANNEL)),
            Quantity("gradient", _gradient, (_PART, _TEXELS, _CHANNEL), "base_color"),
            Quantity("jacobian", _jacobian, (_PIXELS, _PART, _TEXELS), "base_color"),
            Quantity("environment", _environment, (("sky", _CELLS), _CHANNEL), "environment"),
        )
    }
)
