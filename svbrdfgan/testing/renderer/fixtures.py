"""A small scene, and every method of a renderer run on it."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import torch
from torch import Tensor

from svbrdfgan.rendering.checked_renderer import CheckedRenderer
from svbrdfgan.testing import scenes
from svbrdfgan.types import Gradients, Rendering, Surface


class ExampleScene:
    """Two parts, one of them textured, in light of different radiance in every pixel."""

    def __init__(self) -> None:
        self.texture = scenes.random_texture(5, 4)
        self.materials = scenes.lambertian(self.texture, torch.tensor(scenes.RED))
        self.view = scenes.front_view(scenes.random_light(), width=8, height=5)
        self.surface: Surface = scenes.two_parts()
        self.grad_image = torch.randn(5, 8, 3, generator=torch.Generator().manual_seed(0))

    def held(self) -> dict[str, Tensor]:
        """Every array and tensor in it; arrays as tensors that share their memory."""
        arrays = {name: getattr(self.surface, name) for name in ("positions", "normals", "uv", "faces", "face_part")}
        tensors = {
            "texture": self.texture,
            "environment": self.view.environment.radiance,
            "grad_image": self.grad_image,
        }
        return tensors | {f"surface.{name}": torch.from_numpy(array) for name, array in arrays.items()}

    def render(self, renderer: CheckedRenderer) -> Rendering:
        """The picture."""
        return renderer.render(renderer.prepare(self.surface), self.materials, self.view, spp=2, seed=1)

    def uses(self, renderer: Any) -> Iterator[Tensor]:
        """The tensors of a picture, a gradient, both by a pullback, transport and stored light, one step at a time."""
        prepared, capabilities = renderer.prepare(self.surface), renderer.capabilities
        yield from _pictures(renderer.render(prepared, self.materials, self.view, spp=2, seed=1))
        wrt = capabilities.differentiable
        vjp = partial(renderer.render_vjp, prepared, self.materials, self.view, self.grad_image)
        yield from _gradients(vjp(wrt=wrt, spp=2, seed=1))
        if capabilities.pullback:
            kept, pullback = renderer.render_pullback(prepared, self.materials, self.view, wrt=wrt, spp=2, seed=1)
            yield from _pictures(kept)
            yield from _gradients(pullback(self.grad_image))
        if capabilities.transport:
            yield from (samples.weight for samples in renderer.transport(prepared, self.view, spp=2, seed=1))
        if capabilities.deferred:
            light = renderer.store_light(prepared, self.view, learnable=(0,), hits=1, spp=2, seed=1)
            images, stored = renderer.shade([light], self.texture[None], maps=("base_color",), visit=0, seed=1)
            yield images
            yield stored(self.grad_image[None])


def _pictures(rendering: Rendering) -> Iterator[Tensor]:
    yield rendering.image
    yield rendering.coverage


def _gradients(gradients: Gradients) -> Iterator[Tensor]:
    yield from (gradient for part in gradients.materials for gradient in part.values())
    if gradients.environment is not None:
        yield gradients.environment
