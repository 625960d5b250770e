"""Whole materials, and gradients of roughness, metallic and normal maps, against quadrature."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan.testing import scenes
from svbrdfgan.testing.kit import declared
from svbrdfgan.testing.quadrature import Quadrature
from svbrdfgan.testing.renderer import cases
from svbrdfgan.testing.renderer.cases import Case, RenderedCase
from svbrdfgan.testing.renderer.statistical_assertions import StatisticalKit, exactly
from svbrdfgan.testing.statistics import block_sums

_BLOCK = 4
_MOST = 8_000_000

Summary = Callable[[Float[ndarray, "grads rows cols channels"]], Float[ndarray, "*shape"]]


class MapGradientTests(StatisticalKit):
    """All maps that the renderer declares at once: textures, tilted and bent normals, metal, gloss.

    At full power the gradient of each map is found wrong, with probability 95 %, if it is off by 8 % of the largest
    in any texel, or by 1 % in total.
    """

    def test_image_of_whole_materials(self) -> None:
        """A plane with all maps looks as quadrature says, to 3 % in blocks."""
        self._declared_maps("roughness", "normal")
        case = cases.whole(self.capabilities.maps, scenes.random_light(rotation=0.9))
        known = self.known(case, lambda scene: block_sums(scene.image(), _BLOCK), split=8)
        rendered = RenderedCase(self.renderer, case)

        def measure(spp: int, seed: int) -> Float[ndarray, "*shape"]:
            return block_sums(rendered.image(spp=spp, seed=seed), _BLOCK)

        self.unbiased("image, by blocks", rendered, measure, known, claim=0.03, spp=16)

    def test_image_of_metal_in_total(self) -> None:
        """The picture of a metal plane is as quadrature says, to 0.5 % in total."""
        declared("metallic" in self.capabilities.maps, "metallic")
        case = cases.glossy(0.45).with_map(0, "metallic", torch.ones(1))
        known = self.known(case, lambda scene: scene.image().sum(axis=(0, 1)), split=32)
        rendered = RenderedCase(self.renderer, case)

        def measure(spp: int, seed: int) -> Float[ndarray, " channels"]:
            return rendered.image(spp=spp, seed=seed).sum(axis=(0, 1))

        self.unbiased("image, in total", rendered, measure, known, claim=0.005, spp=512)

    def test_roughness_gradients_of_whole_materials(self) -> None:
        """Every texel's gradient of roughness beside all other maps is as quadrature says, to 8 %."""
        self._in_each_texel("roughness")

    def test_metallic_gradients_of_whole_materials(self) -> None:
        """Every texel's gradient of metallic beside all other maps is as quadrature says, to 8 %."""
        self._in_each_texel("metallic")

    def test_normal_gradients_of_whole_materials(self) -> None:
        """Every texel's gradient of the normal beside all other maps is as quadrature says, to 8 %."""
        self._in_each_texel("normal")

    def test_the_gradient_of_roughness_in_total(self) -> None:
        """The sum of the gradient of roughness over all texels is as quadrature says, to 1 %."""
        self._in_total("roughness")

    def test_the_gradient_of_metallic_in_total(self) -> None:
        """The sum of the gradient of metallic over all texels is as quadrature says, to 1 %."""
        self._in_total("metallic")

    def test_the_gradient_of_the_normal_in_total(self) -> None:
        """The sum of the gradient of the normal over all texels is as quadrature says, to 1 %."""
        self._in_total("normal")

    def test_normal_gradients_of_bent_normals(self) -> None:
        """Every texel's gradient of normals that are bent to the viewer is as quadrature says, to 8 %."""
        self._in_each_texel("normal", cases.rim(self.capabilities.maps))

    def test_the_gradient_of_a_normal_is_perpendicular_to_it(self) -> None:
        """As its length does not matter, a normal's gradient is perpendicular to it, and half for twice the length."""
        self._declared_gradient("normal")
        base, normal = cases.whole(self.capabilities.maps), torch.tensor([0.3, -0.2, 0.5])
        short, long = (base.with_map(0, "normal", scale * normal) for scale in (1.0, 2.0))
        found, half = (
            RenderedCase(self.renderer, case).map_gradient(base.smooth(), "normal", 0, spp=16) for case in (short, long)
        )
        length = np.sqrt((found**2).sum(keepdims=True))
        along = found @ (normal / normal.norm()).double().numpy()
        exactly("The gradient's length, and what it has along the normal", length + along, length)
        exactly("The gradient of a normal of twice the length, doubled", 2.0 * half, found)

    def _in_each_texel(self, name: str, case: Case | None = None) -> None:
        case = case or cases.whole(self.capabilities.maps)
        grads = case.smooth(), 1.0 + 0.5 * case.random()
        self._unbiased_gradient(name, case, grads, lambda gradient: gradient, claim=0.08, spp=64)

    def _in_total(self, name: str) -> None:
        case = cases.whole(self.capabilities.maps)

        def total(gradient: ndarray) -> ndarray:
            return np.asarray(gradient.sum(axis=(1, 2)))

        self._unbiased_gradient(name, case, (case.smooth(),), total, claim=0.01, spp=512)

    def _unbiased_gradient(
        self, name: str, case: Case, grads: tuple[ndarray, ...], summary: Summary, *, claim: float, spp: int
    ) -> None:
        self._declared_gradient(name)

        def true(scene: Quadrature) -> ndarray:
            return summary(scene.map_gradients(name, grads, 0))

        known = self.known(case, true, split=16)
        axes = tuple(range(1, known.size.ndim))
        largest = np.broadcast_to(known.size.max(axis=axes, keepdims=True), known.size.shape)
        rendered = RenderedCase(self.renderer, case)

        def measure(spp: int, seed: int) -> Float[ndarray, "*shape"]:
            gradients = [rendered.map_gradient(grad, name, 0, spp=spp, seed=seed) for grad in grads]
            return summary(np.stack(gradients))

        what = f"gradient of {name}"
        known = replace(known, size=largest)
        self.unbiased(what, rendered, measure, known, claim=claim, spp=spp, most=_MOST)

    def _declared_maps(self, *names: str) -> None:
        declared(bool(self.capabilities.maps & set(names)), " or ".join(names))

    def _declared_gradient(self, name: str) -> None:
        declared(name in self.capabilities.differentiable, f"the gradient of {name}")
