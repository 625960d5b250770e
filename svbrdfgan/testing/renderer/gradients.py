"""Gradients: exactly those of the same picture where the contract demands it, unbiased elsewhere."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray
from torch import Tensor

from svbrdfgan.testing import scenes
from svbrdfgan.testing.kit import check, declared
from svbrdfgan.testing.renderer import cases
from svbrdfgan.testing.renderer.cases import Case, Picture, RenderedCase, flat
from svbrdfgan.testing.renderer.statistical_assertions import Known, StatisticalKit, exactly
from svbrdfgan.testing.statistics import numbers
from svbrdfgan.types import Material, Materials

_STEP = 0.04
_SINGLE = 5e-5
"""What single precision may lose, of the largest gradient. Half precision, or bfloat16, loses more."""
_HINT = (
    "Probably it is not of the samples that the picture has at the same spp and seed; or what these are depends on "
    "base_color, as with Russian roulette by throughput, or with a lobe chosen by albedo."
)


class GradientTests(StatisticalKit):
    """`render_vjp` against the renderer's own pictures. Whether those are right is for other tests."""

    def test_base_color_of_every_texel_of_every_part(self) -> None:
        """At the same seed each texel's and constant's gradient is that of the picture."""
        self._require_own_gradient(cases.strips())

    def test_base_color_of_textures_that_repeat(self) -> None:
        """At a border the gradient goes to the other side where textures repeat."""
        for repeat in ((True, False), (False, True)):
            self._require_own_gradient(cases.whole_sheet(repeat))

    def test_base_color_where_parts_light_one_another(self) -> None:
        """The gradient counts as many bounces as the picture."""
        self._require_own_gradient(cases.corner())

    def test_base_color_beneath_gloss(self) -> None:
        """Beneath gloss, too, the base colour's gradient is that of the picture."""
        declared("roughness" in self.capabilities.maps, "roughness")
        self._require_own_gradient(cases.glossy(torch.tensor([[0.3, 0.9], [0.6, 0.4]])[..., None]))

    def test_base_color_beneath_all_maps(self) -> None:
        """Beside every other map, too, and where parts light one another, it is that of the picture."""
        declared(len(self.capabilities.maps) > 1, "another map")
        self._require_own_gradient(cases.whole(self.capabilities.maps))
        self._require_own_gradient(cases.rich(self.capabilities.maps))

    def test_base_color_behind_clear_parts(self) -> None:
        """Behind, above and on parts that rays pass through, it is that of the picture."""
        declared(self.capabilities.alpha, "alpha")
        self._require_own_gradient(cases.clear())

    def test_unseen_texels_have_no_gradient(self) -> None:
        """Texels and parts that are lit, but not seen, have a gradient of exactly zero."""
        self._declared("base_color")
        case = cases.screened()
        rendered = RenderedCase(self.renderer, case)
        plane, behind = (rendered.map_gradient(case.smooth(), "base_color", part, spp=16) for part in (0, 1))
        unseen = np.ones((8, 8), dtype=bool)
        unseen[1:7, 1:7] = False
        check(
            not plane[unseen].any(), f"Texels outside the picture have gradients up to {abs(plane[unseen]).max():.3g}."
        )
        check(bool((plane[2:6, 2:6] > 0.0).all()), "Some texels in the picture, and lit, have no positive gradient.")
        check(not behind.any(), f"A part hidden behind another has gradients up to {abs(behind).max():.3g}; wanted 0.")

    def test_unlit_texels_have_no_gradient(self) -> None:
        """What is seen, but lit from behind alone, has a gradient of exactly zero."""
        self._declared("base_color")
        case = cases.lidded(scenes.random_light(8, 4))
        radiance = case.view.environment.radiance.clone()
        radiance[:5] = 0.0  # light from below, and bilinear lookups stay there
        rendered = RenderedCase(self.renderer, case.lit_by(radiance))
        gradient = rendered.map_gradient(case.smooth(), "base_color", 0, spp=16)
        check(not gradient.any(), f"In the dark there are gradients up to {abs(gradient).max():.3g}; wanted 0.")

    def test_environment_sums_to_the_picture(self) -> None:
        """At the same seed sum(gradient * environment) is sum(image * grad_image)."""
        self._declared("environment")
        for case in self._lit_cases():
            rendered, grad = RenderedCase(self.renderer, case), case.smooth()
            radiance = numbers(case.view.environment.radiance)
            found, wanted = (rendered.light_gradient(grad) * radiance).sum(), (rendered.image() * grad).sum()
            exactly("sum(environment gradient * environment)", np.array([found]), np.array([wanted]))

    def test_environment_moves_the_picture(self) -> None:
        """On average the environment's gradient is what each row does to the picture.

        To 10 % of each row's share, or of a quarter of the largest.
        """
        self._declared("environment")
        case = cases.corner()
        rendered, grad = RenderedCase(self.renderer, case), case.smooth()
        radiance = case.view.environment.radiance
        lights = [
            case.lit_by(torch.zeros_like(radiance).index_copy(0, i, radiance[i])) for i in torch.arange(4).split(1)
        ]

        def apart(spp: int, seed: int) -> Float[ndarray, " rows"]:
            rows = (rendered.light_gradient(grad, spp=spp, seed=seed) * numbers(radiance)).sum(axis=(1, 2))
            images = [rendered.image(light, spp=spp, seed=seed + 1000 * i) for i, light in enumerate(lights, start=1)]
            return np.array([row - (image * grad).sum() for row, image in zip(rows, images, strict=True)])

        size = np.array([abs((rendered.image(light, spp=16) * grad).sum()) for light in lights])
        size = np.maximum(size, 0.25 * size.max())
        self.unbiased(
            "environment gradient less the picture's change, by rows",
            rendered,
            apart,
            Known.zero(size),
            claim=0.1,
            spp=16,
        )

    def test_roughness_below_its_bound_has_no_gradient(self) -> None:
        """The gradient of roughness is exactly zero below 0.05, and not at 0.3."""
        self._declared("roughness")
        for roughness, moves in ((0.02, False), (0.3, True)):
            case = cases.glossy(roughness)
            gradient = RenderedCase(self.renderer, case).map_gradient(case.smooth(), "roughness", 0, spp=64)
            check(gradient.any() == moves, f"At roughness {roughness} the gradient is {gradient}.")

    def test_linear_in_the_cotangent(self) -> None:
        """The gradient for 2 a - 3 b is 2 times that for a less 3 times that for b, in single precision."""
        case = cases.rich(self.capabilities.maps)
        rendered, wrt, a, b = (
            RenderedCase(self.renderer, case),
            cases.differentiable(self.capabilities),
            case.smooth(),
            case.random(),
        )
        of_a, of_b, of_both, of_none = (flat(rendered.gradients(g, *wrt)) for g in (a, b, 2.0 * a - 3.0 * b, 0.0 * a))
        for name, both in of_both.items():
            what = f"The gradient of 2 a - 3 b in {name}"
            exactly(what, both, 2.0 * of_a[name] - 3.0 * of_b[name], rounding=_SINGLE)
            check(
                not of_none[name].any(),
                f"A cotangent of zero has a gradient of {abs(of_none[name]).max():.3g} in {name}.",
            )

    def test_inputs_together_are_as_each_alone(self) -> None:
        """The gradient of one input is the same whatever else is asked for."""
        case = cases.rich(self.capabilities.maps)
        rendered = RenderedCase(self.renderer, case)
        together = flat(rendered.gradients(case.smooth(), *cases.differentiable(self.capabilities)))
        for name in cases.differentiable(self.capabilities):
            for place, gradient in flat(rendered.gradients(case.smooth(), name)).items():
                check(place in together, f"{place} has a gradient when asked for alone, and none among others.")
                exactly(f"The gradient of {place}, asked for alone", gradient, together[place])

    def test_finite_in_the_dark_and_on_black(self) -> None:
        """On black and in the dark gradients are finite; of what is unlit, zero."""
        case = cases.rich(self.capabilities.maps)
        black = cases.Case(case.surface, _blackened(case.materials), case.view)
        dark = case.lit_by(torch.zeros_like(case.view.environment.radiance))
        for name, scene in (("on black", black), ("in the dark", dark)):
            for place, gradient in flat(
                RenderedCase(self.renderer, scene).gradients(case.smooth(), *cases.differentiable(self.capabilities))
            ).items():
                check(bool(np.isfinite(gradient).all()), f"The gradient of {place} {name} is not finite.")
                if scene is dark and place != "environment":
                    check(not gradient.any(), f"The gradient of {place} {name} is {abs(gradient).max():.3g}; wanted 0.")

    def _require_own_gradient(self, case: Case) -> None:
        """Fails unless the gradient of each base colour is that of the picture at the same seed."""
        self._declared("base_color")
        rendered = RenderedCase(self.renderer, case)
        for part in range(len(case.materials)):
            jacobian = PictureJacobian.by_differences(rendered, part, spp=4, seed=3)
            for kind, grad in (("smooth", case.smooth()), ("random", case.random())):
                found = rendered.map_gradient(grad, "base_color", part)
                what = f"gradient of the base colour of part {part} for a {kind} cotangent"
                exactly(what, found, jacobian.vjp(grad), hint=_HINT)

    def _declared(self, name: str) -> None:
        declared(name in self.capabilities.differentiable, f"the gradient of {name}")

    def _lit_cases(self) -> Iterator[Case]:
        yield cases.strips()
        yield cases.corner()
        yield cases.sheet(scenes.sun(30, 5, rotation=0.4))
        if "roughness" in self.capabilities.maps:
            yield cases.glossy(0.4)
        if len(self.capabilities.maps) > 1:
            yield cases.rich(self.capabilities.maps)
        if self.capabilities.alpha:
            yield cases.clear()


@dataclass(frozen=True, eq=False)
class PictureJacobian:
    """The derivative of each pixel by each texel of one part's base colour, each channel by its own.

    Attributes:
        shape: of the base colour.
    """

    derivative: Float[ndarray, "texels height width 3"]
    shape: tuple[int, ...]

    @classmethod
    def by_differences(cls, rendered: RenderedCase, part: int, *, spp: int, seed: int) -> PictureJacobian:
        """Derivatives by differences at one seed, by a rule that is exact up to degree four: up to four bounces."""
        value = rendered.case.materials[part].base_color

        def picture(texel: int, steps: int) -> Picture:
            moved: Tensor = value.clone().reshape(-1, 3)
            moved[texel] += steps * _STEP
            case = rendered.case.with_map(part, "base_color", moved.reshape(value.shape))
            return rendered.image(case, spp=spp, seed=seed)

        def derivative(texel: int) -> Picture:
            near, far = (picture(texel, steps) - picture(texel, -steps) for steps in (1, 2))
            return np.asarray((8.0 * near - far) / (12.0 * _STEP))

        texels = range(value.numel() // 3)
        return cls(np.stack([derivative(texel) for texel in texels]), tuple(value.shape))

    def vjp(self, grad: Picture) -> Float[ndarray, "*shape"]:
        """The gradient of sum(image * grad) in the base colour."""
        return np.asarray(np.einsum("thwc,hwc->tc", self.derivative, grad).reshape(self.shape))


def _blackened(materials: Materials) -> Materials:
    """The same materials with black base colours."""
    parts = [{**material.maps, "base_color": torch.zeros_like(material.base_color)} for material in materials.parts]
    return Materials(tuple(Material(maps) for maps in parts))
