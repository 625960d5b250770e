"""Stored light transport and the torch layer, which the core builds on a renderer. Both must agree with it."""

from __future__ import annotations

from collections.abc import Iterator

import torch
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan.geometry.texels import sample_texture
from svbrdfgan.rendering.checked_renderer import CheckedRenderer
from svbrdfgan.rendering.render_layer import RenderLayer
from svbrdfgan.testing.kit import check, declared
from svbrdfgan.testing.renderer import cases
from svbrdfgan.testing.renderer.base import RendererKit
from svbrdfgan.testing.renderer.cases import Case, Picture, RenderedCase, flat
from svbrdfgan.testing.renderer.statistical_assertions import exactly
from svbrdfgan.testing.statistics import numbers
from svbrdfgan.types import Material, Materials


class LayerTests(RendererKit):
    """The same samples by `render`, `transport`, `render_pullback` and `RenderLayer`."""

    def test_transport_times_texture_is_the_picture(self) -> None:
        """Transport times base colours is the picture; its records are the coverage."""
        for rendered in self._transported():
            image, coverage, _ = _from_samples(self.renderer, rendered)
            exactly("transport times base colour", image, rendered.image())
            shown = self.renderer.render(rendered.prepared, rendered.case.materials, rendered.case.view, spp=4, seed=3)
            exactly("the share of samples that met the surface", coverage, numbers(shown.coverage))

    def test_transport_transposed_is_the_gradient(self) -> None:
        """Transport, transposed, makes the gradient that `render_vjp` gives."""
        declared("base_color" in self.capabilities.differentiable, "the gradient of base_color")
        for rendered in self._transported():
            grad = rendered.case.random()
            _, _, colors = _from_samples(self.renderer, rendered, grad)
            for part, wanted in enumerate(colors):
                exactly(f"gradient of part {part}", rendered.map_gradient(grad, "base_color", part), wanted)

    def test_pullback_is_the_gradient(self) -> None:
        """`render_pullback` gives `render`'s picture, and `render_vjp`'s gradient of every cotangent."""
        declared(self.capabilities.pullback, "pullback")
        able = cases.differentiable(self.capabilities)
        for maps in {frozenset({"base_color"}), self.capabilities.maps}:
            for wrt in (able, *([name] for name in able)):
                self._require_pullback(cases.rich(maps), frozenset(wrt))

    def test_render_layer_gives_torch_these_gradients(self) -> None:
        """`RenderLayer` gives torch the picture, and `render_vjp` as its gradient."""
        wrt = cases.differentiable(self.capabilities)
        case = cases.rich(self.capabilities.maps)
        rendered, grad = RenderedCase(self.renderer, case), case.random()
        maps = [{n: v.clone().requires_grad_(n in wrt) for n, v in m.maps.items()} for m in case.materials.parts]
        light = case.view.environment.radiance.clone().requires_grad_("environment" in wrt)
        lit = Case(case.surface, Materials(tuple(map(Material, maps))), case.lit_by(light).view)
        layer = RenderLayer(self.renderer, spp=4)
        image = layer(rendered.prepared, lit.materials, lit.view, seed=3).image
        exactly("RenderLayer's picture", numbers(image), rendered.image())
        (image.double() * torch.from_numpy(grad).to(image.device)).sum().backward()
        for place, wanted in flat(rendered.gradients(grad, *wrt)).items():
            part, _, name = place.rpartition(" ")
            leaf = light if name == "environment" else maps[int(part.removeprefix("part "))][name]
            check(leaf.grad is not None, f"torch has no gradient for {place}.")
            assert leaf.grad is not None
            exactly(f"torch's gradient for {place}", numbers(leaf.grad), wanted)

    def _require_pullback(self, case: Case, wrt: frozenset[str]) -> None:
        rendered = RenderedCase(self.renderer, case)
        rendering, pullback = self.renderer.render_pullback(
            rendered.prepared, case.materials, case.view, wrt=wrt, spp=4, seed=3
        )
        exactly("picture", numbers(rendering.image), rendered.image())
        for grad in (case.random(), case.random()[::-1].copy()):
            found = flat(pullback(torch.from_numpy(grad).float()))
            for place, wanted in flat(rendered.gradients(grad, *wrt)).items():
                check(place in found, f"asked for {', '.join(sorted(wrt))}, it has no gradient for {place}.")
                exactly(f"gradient for {place}", found[place], wanted)

    def _transported(self) -> Iterator[RenderedCase]:
        declared(self.capabilities.transport, "transport")
        clear = (cases.clear(),) if self.capabilities.alpha else ()
        for case in (cases.strips(), cases.whole_sheet((True, False)), cases.lidded(), cases.screened(), *clear):
            yield RenderedCase(self.renderer, case)


def _from_samples(
    renderer: CheckedRenderer, rendered: RenderedCase, grad: Picture | None = None
) -> tuple[Picture, Float[ndarray, "height width"], list[ndarray]]:
    """The picture and its coverage, by the samples of `transport`; and for each part the base colour's gradient."""
    case, (height, width) = rendered.case, (rendered.case.view.height, rendered.case.view.width)
    colors = [material.base_color.double().requires_grad_() for material in case.materials.parts]
    image, count = (torch.zeros(height * width, n, dtype=torch.float64) for n in (3, 1))
    for chunk in renderer.transport(rendered.prepared, case.view, spp=4, seed=3):
        pixel, owner, uv = chunk.pixel.cpu().long(), chunk.part.cpu(), chunk.uv.cpu().double()
        weight = chunk.weight.cpu().double()
        count.index_add_(0, pixel, torch.ones(len(pixel), 1, dtype=torch.float64))
        for part, color in enumerate(colors):
            mine = owner == part
            textured = color if color.ndim == 3 else color.reshape(1, 1, 3)
            seen = sample_texture(textured, uv[mine], case.surface.repeat)
            image = image.index_add(0, pixel[mine], weight[mine] * seen)
    film = (height, width, 3)
    if grad is not None:
        (image * torch.from_numpy(grad).reshape(-1, 3)).sum().backward()
    grads = [numbers(torch.zeros_like(color) if color.grad is None else color.grad) for color in colors]
    return numbers(image).reshape(film), numbers(count / 4).reshape(height, width), grads
