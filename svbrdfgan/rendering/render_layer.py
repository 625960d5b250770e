"""A renderer as a differentiable torch function (thesis A.1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from svbrdfgan.protocols import Pullback
from svbrdfgan.rendering.checked_renderer import CheckedRenderer, PreparedSurface
from svbrdfgan.types import Environment, Gradients, Material, Materials, Rendering, View


@dataclass(frozen=True)
class RenderLayer:
    """Renders with gradients for each map, and for the environment, that requires one.

    Attributes:
        renderer: any backend, as `load_renderer` returns it.
        spp: samples per pixel of the image.
        spp_grad: samples per pixel of the gradient, which are independent of the image's, so that the gradient of a
            loss is unbiased (thesis 4.3.3). None reuses the image's samples: the gradient is exactly that image's.
    """

    renderer: CheckedRenderer
    spp: int = 16
    spp_grad: int | None = None

    def __call__(self, prepared: PreparedSurface, materials: Materials, view: View, *, seed: int) -> Rendering:
        """The image and its coverage; the image carries gradients to the materials and the environment.

        Raises:
            UnsupportedError: an input requires a gradient and is not in the renderer's `differentiable`.
        """
        names = [(part, name) for part, material in enumerate(materials.parts) for name in sorted(material.maps)]
        values = [materials[part].maps[name] for part, name in names]
        radiance = view.environment.radiance
        wrt = {name for (_, name), value in zip(names, values, strict=True) if value.requires_grad}
        if radiance.requires_grad:
            wrt.add("environment")
        needed = frozenset(wrt if torch.is_grad_enabled() else ())
        self.renderer.require_differentiable(needed)  # now, and not when the gradient is asked for
        call = _Call(self, prepared, names, view, seed, needed)
        image, coverage = _Render.apply(call, radiance, *values)
        return Rendering(image, coverage)


@dataclass(frozen=True, eq=False)
class _Call:
    """The inputs of one call that are not differentiated, and the names of those that are."""

    layer: RenderLayer
    prepared: PreparedSurface
    names: list[tuple[int, str]]
    view: View
    seed: int
    wrt: frozenset[str]

    def scene(self, radiance: Tensor, values: tuple[Tensor, ...]) -> tuple[Materials, View]:
        maps: list[dict[str, Tensor]] = [{} for _ in range(1 + max(part for part, _ in self.names))]
        for (part, name), value in zip(self.names, values, strict=True):
            maps[part][name] = value.detach()
        environment = Environment(radiance.detach(), self.view.environment.rotation)
        view = View(self.view.camera, environment, self.view.width, self.view.height)
        return Materials(tuple(Material(m) for m in maps)), view

    def render(self, materials: Materials, view: View) -> tuple[Rendering, Pullback | None]:
        """The image and, if the gradient reuses its samples and the renderer can keep them, its pullback."""
        renderer, spp = self.layer.renderer, self.layer.spp
        if self.wrt and self.layer.spp_grad is None and renderer.capabilities.pullback:
            return renderer.render_pullback(self.prepared, materials, view, wrt=self.wrt, spp=spp, seed=self.seed)
        return renderer.render(self.prepared, materials, view, spp=spp, seed=self.seed), None

    def gradients(self, materials: Materials, view: View, grad_image: Tensor) -> Gradients:
        """The gradients by a second tracing."""
        layer, spp, seed = self.layer, self.layer.spp, self.seed
        if layer.spp_grad is not None:
            spp, seed = layer.spp_grad, _other_seed(self.seed)
        return layer.renderer.render_vjp(self.prepared, materials, view, grad_image, wrt=self.wrt, spp=spp, seed=seed)


class _Render(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, call: _Call, radiance: Tensor, *values: Tensor) -> tuple[Tensor, Tensor]:
        rendering, pullback = call.render(*call.scene(radiance, values))
        ctx.call, ctx.pullback = call, pullback
        ctx.save_for_backward(radiance, *values)
        ctx.mark_non_differentiable(rendering.coverage)
        return rendering.image, rendering.coverage

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, grad_image: Float[Tensor, "height width 3"], _: Tensor) -> tuple[Tensor | None, ...]:
        call: _Call = ctx.call
        pullback: Pullback | None = ctx.pullback
        radiance, *values = ctx.saved_tensors
        if pullback is None:
            gradients = call.gradients(*call.scene(radiance, tuple(values)), grad_image)
        else:
            gradients = pullback(grad_image)
        needs_light, *needs = ctx.needs_input_grad[1:]
        light = _like(gradients.environment, radiance) if needs_light else None
        maps = [
            _like(gradients.materials[part][name], value) if need else None
            for (part, name), value, need in zip(call.names, values, needs, strict=True)
        ]
        return (None, light, *maps)


def _like(gradient: Tensor | None, value: Tensor) -> Tensor | None:
    return None if gradient is None else gradient.to(device=value.device, dtype=value.dtype)


def _other_seed(seed: int) -> int:
    """A seed for the backward pass, far from those that forward passes of nearby seeds use."""
    return (seed * 0x9E3779B1 + 0x7F4A7C15) % 2**31
