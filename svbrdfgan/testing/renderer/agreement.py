"""The renderer against quadrature for direct light, and against `numpy` for interreflection."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan.plugins.registry import load_renderer
from svbrdfgan.testing import scenes
from svbrdfgan.testing.kit import declared
from svbrdfgan.testing.renderer import cases
from svbrdfgan.testing.renderer.cases import Case, RenderedCase
from svbrdfgan.testing.renderer.statistical_assertions import Known, StatisticalKit
from svbrdfgan.testing.statistics import block_sums

_BLOCK = 4


class AgreementTests(StatisticalKit):
    """Pictures in blocks of 4 x 4 pixels, and gradients in blocks of texels and of the environment's pixels.

    At full power every test detects, with probability 95 %, an error of 3 % in pictures and of 5 % in gradients and
    at several bounces (8 % in shadow and of roughness), in any block and channel that holds 2 % of the sum. A right
    renderer fails once in 10,000 times.
    """

    def test_image_of_a_textured_plane(self) -> None:
        """A textured plane looks as quadrature says, to 3 % in every block."""
        self._image(cases.sheet(scenes.random_light(rotation=0.9)))

    def test_image_of_a_floor_under_a_lid(self) -> None:
        """A half shadowed floor looks as quadrature says, to 3 % in every block."""
        self._image(cases.lidded(scenes.random_light(rotation=0.9)), split=8)

    def test_image_of_three_parts(self) -> None:
        """Three parts look as quadrature says, to 3 % in every block."""
        self._image(cases.strips(scenes.random_light(rotation=0.9)))

    def test_image_under_a_strong_sun(self) -> None:
        """A plane in a strong sun looks as quadrature says, to 3 % in every block."""
        self._image(cases.sheet(scenes.sun(30, 5, rotation=0.4)))

    def test_image_in_low_light(self) -> None:
        """A plane in very low light looks as quadrature says, to 3 % in every block."""
        light = scenes.random_light(rotation=0.9)
        self._image(cases.sheet(replace(light, radiance=1e-4 * light.radiance)))

    def test_image_of_gloss(self) -> None:
        """A plane of varying roughness looks as quadrature says, to 3 % in blocks."""
        declared("roughness" in self.capabilities.maps, "roughness")
        roughness = torch.tensor([[0.3, 0.9, 0.5], [0.7, 0.4, 1.0]]).reshape(2, 3, 1)
        self._image(cases.glossy(roughness, scenes.random_light(rotation=0.9)))

    def test_image_behind_clear_parts(self) -> None:
        """Parts that rays pass through, their shadows and what is behind look as quadrature says, to 3 % in blocks."""
        declared(self.capabilities.alpha, "alpha")
        declared(self.capabilities.max_bounces == 1, "direct light alone")
        self._image(cases.clear(), split=8)

    def test_texel_gradients_of_three_parts(self) -> None:
        """Every texel's gradient on three parts is as quadrature says, to 5 %."""
        case = cases.strips(scenes.random_light(rotation=0.9))
        for part in range(3):
            self._texels(case, part, grid=8)

    def test_texel_gradients_in_shadow(self) -> None:
        """Every texel's gradient on a half shadowed floor is as quadrature says, to 8 %."""
        self._texels(cases.lidded(scenes.random_light(rotation=0.9)), 0, grid=8, claim=0.08)

    def test_texel_gradients_under_a_strong_sun(self) -> None:
        """Every texel's gradient in a strong sun is as quadrature says, to 5 %."""
        self._texels(cases.sheet(scenes.sun(30, 5, rotation=0.4)), 0)

    def test_roughness_gradients_of_gloss(self) -> None:
        """Every texel's gradient of roughness is as quadrature says, to 8 %."""
        declared("roughness" in self.capabilities.differentiable, "the gradient of roughness")
        case = cases.glossy(torch.tensor([[0.5, 0.9, 0.6], [0.7, 0.4, 0.8]])[..., None])
        grads = (case.smooth(), 1.0 + 0.5 * case.random())
        known = self.known(case, lambda scene: scene.map_gradients("roughness", grads, 0), split=16)
        largest = np.broadcast_to(known.size.max(axis=(1, 2, 3), keepdims=True), known.size.shape)
        rendered = RenderedCase(self.renderer, case)

        def measure(spp: int, seed: int) -> Float[ndarray, "*shape"]:
            return np.stack([rendered.map_gradient(grad, "roughness", 0, spp=spp, seed=seed) for grad in grads])

        self.unbiased("gradient of roughness", rendered, measure, replace(known, size=largest), claim=0.08, spp=64)

    def test_environment_gradient_in_the_open(self) -> None:
        """The environment's gradient is as quadrature says, to 5 % in pairs of pixels."""
        self._light(cases.sheet())

    def test_environment_gradient_through_shadow(self) -> None:
        """The environment's gradient through shadow is as quadrature says, to 8 %."""
        self._light(cases.lidded(), grid=8, claim=0.08)

    def test_interreflection_as_numpy(self) -> None:
        """Parts that light one another look as `numpy` renders them, to 5 % in blocks."""
        self._interreflection(cases.corner())

    def test_interreflection_of_metal_as_numpy(self) -> None:
        """Parts with metal, gloss and tilted normals light one another as by `numpy`, to 5 % in blocks."""
        declared(len(self.capabilities.maps) > 1, "another map")
        self._interreflection(cases.rich(self.capabilities.maps))

    def test_interreflection_behind_clear_parts_as_numpy(self) -> None:
        """Parts behind clear ones light one another as by `numpy`, to 5 % in blocks."""
        declared(self.capabilities.alpha, "alpha")
        self._interreflection(cases.clear_corner())

    def _interreflection(self, case: Case) -> None:
        bounces = self.capabilities.max_bounces
        declared(bounces > 1, "a second bounce")
        declared(self.name != "numpy", "another renderer than numpy")
        mine = RenderedCase(self.renderer, case)
        other = RenderedCase(load_renderer("numpy", {"max_bounces": bounces}), case)
        size = block_sums(other.image(spp=16), _BLOCK)

        def apart(spp: int, seed: int) -> Float[ndarray, "*shape"]:
            return block_sums(mine.image(spp=spp, seed=seed) - other.image(spp=spp, seed=seed + 10**6), _BLOCK)

        self.unbiased("image less that of numpy", mine, apart, Known.zero(size), claim=0.05, spp=16)

    def _image(self, case: Case, split: int = 4) -> None:
        known = self.known(case, lambda scene: block_sums(scene.image(), _BLOCK), split=split)
        rendered = RenderedCase(self.renderer, case)

        def measure(spp: int, seed: int) -> Float[ndarray, "*shape"]:
            return block_sums(rendered.image(spp=spp, seed=seed), _BLOCK)

        self.unbiased("image, by blocks", rendered, measure, known, claim=0.03, spp=16)

    def _texels(self, case: Case, part: int, grid: int = 4, claim: float = 0.05) -> None:
        grad = case.smooth()
        known = self.known(case, lambda scene: scene.texel_gradients(grad)[part], grid)
        rendered = RenderedCase(self.renderer, case)

        def measure(spp: int, seed: int) -> Float[ndarray, "*shape"]:
            return rendered.map_gradient(grad, "base_color", part, spp=spp, seed=seed)

        self.unbiased(f"gradient of the base colour of part {part}", rendered, measure, known, claim=claim, spp=16)

    def _light(self, case: Case, grid: int = 4, claim: float = 0.05) -> None:
        declared("environment" in self.capabilities.differentiable, "the environment's gradient")
        grad = case.smooth()
        known = self.known(case, lambda scene: _pairs(scene.environment_gradient(grad)), grid, split=8)
        rendered = RenderedCase(self.renderer, case)

        def measure(spp: int, seed: int) -> Float[ndarray, "*shape"]:
            return _pairs(rendered.light_gradient(grad, spp=spp, seed=seed))

        self.unbiased("gradient of the environment, by pairs of columns", rendered, measure, known, claim=claim, spp=16)


def _pairs(gradient: Float[ndarray, "rows cols 3"]) -> Float[ndarray, "rows pairs 3"]:
    """Sums over pairs of columns, so that each holds enough light."""
    rows, cols, channels = gradient.shape
    return gradient.reshape(rows, cols // 2, 2, channels).sum(axis=2)
