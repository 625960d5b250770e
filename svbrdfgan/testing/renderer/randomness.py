"""Noise: it depends on the seed alone, is independent from seed to seed, and is zero on average."""

from __future__ import annotations

import math

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan.rendering.checked_renderer import checked
from svbrdfgan.rendering.render_layer import RenderLayer
from svbrdfgan.testing.kit import check, declared
from svbrdfgan.testing.renderer import cases
from svbrdfgan.testing.renderer.cases import Case, RenderedCase, flat
from svbrdfgan.testing.renderer.statistical_assertions import StatisticalKit
from svbrdfgan.testing.statistics import Estimate, block_sums, difference, estimate, margin, numbers

_SEEDS = (0, 1, 2**31, 2**32, 2**32 + 1, 2**63 - 1)
_SIGMAS = 5.0
_ATOMICS = 1e-5
"""The relative difference allowed on devices that do not fix the order of additions."""


class RandomnessTests(StatisticalKit):
    """The picture and its gradient as functions of the seed. A deterministic renderer may ignore the seed."""

    def test_same_seed_same_picture(self) -> None:
        """The same seed gives the same picture; on the CPU bit for bit."""
        for name, once, again in self._twice(7, 7):
            off, slack = float(abs(once - again).max()), self._slack * float(abs(once).max())
            check(off <= slack, f"Twice with seed 7, {name} differs by up to {off:.3g}; wanted at most {slack:.3g}.")

    def test_other_seeds_other_pictures(self) -> None:
        """Another seed gives another picture and gradient if the renderer is declared stochastic."""
        for name, once, other in self._twice(7, 8):
            same = float(abs(once - other).max()) <= self._slack * float(abs(once).max())
            given = "stochastic" if self.capabilities.stochastic else "deterministic"
            check(
                same != self.capabilities.stochastic,
                f"A {given} renderer: {name} is {'' if same else 'not '}the same for another seed.",
            )

    def test_large_seeds(self) -> None:
        """Seeds from 0 to 2^63 - 1 are accepted, and no two of them taken for one."""
        rendered = RenderedCase(self.renderer, cases.strips())
        images = [rendered.image(seed=seed) for seed in _SEEDS]
        for i, one in enumerate(images):
            check(bool(np.isfinite(one).all()), f"Seed {_SEEDS[i]} gives a picture that is not finite.")
            for j in range(i) if self.capabilities.stochastic else ():
                check(not np.array_equal(one, images[j]), f"Seeds {_SEEDS[j]} and {_SEEDS[i]} give the same picture.")

    def test_seeds_are_independent(self) -> None:
        """The noise of one seed says nothing about that of the next two."""
        noise = self._noise()
        for step in (1, 2):
            found = float((noise[step:] * noise[:-step]).mean())
            error = 1.0 / math.sqrt(noise[step:].size)
            expected = -1.0 / (len(noise) - 1)  # since the mean was taken from the same pictures
            message = f"Noise of seeds {step} apart correlates by {found:.3f}; wanted {expected:.3f}"
            check(
                abs(found - expected) < _SIGMAS * error,
                f"{message}, within {_SIGMAS * error:.3f}: do they share samples?",
            )

    def test_pixels_are_independent(self) -> None:
        """The noise of one pixel does not go with that of its neighbours.

        Against it, it may go: samples may be spread over the film.
        """
        noise = self._noise()
        for axis, name in ((1, "above one another"), (2, "side by side")):
            one, other = np.delete(noise, 0, axis), np.delete(noise, -1, axis)
            found, error = float((one * other).mean()), 1.0 / math.sqrt(one.size)
            message = f"Noise of pixels {name} correlates by {found:.3f}; wanted at most {_SIGMAS * error:.3f}"
            check(found < _SIGMAS * error, f"{message}: do pixels share random numbers?")

    def test_one_sample_is_unbiased(self) -> None:
        """Pictures of one sample per pixel are right on average, to 5 % in quarters."""
        self._unbiased_image(1, size=64)

    def test_sixteen_samples_are_unbiased(self) -> None:
        """Pictures of 16 samples per pixel are right on average, to 5 % in quarters."""
        self._unbiased_image(16, size=16)

    def test_gradients_of_one_sample_are_unbiased(self) -> None:
        """Gradients of one sample per pixel are right on average, to 5 % in texels."""
        declared("base_color" in self.capabilities.differentiable, "the gradient of base_color")
        case = cases.sheet(size=64, texels=(2, 2))
        rendered, grad = RenderedCase(self.renderer, case), case.smooth()
        known = self.known(case, lambda scene: scene.texel_gradients(grad)[0], grid=2)

        def measure(spp: int, seed: int) -> Float[ndarray, "*shape"]:
            return rendered.map_gradient(grad, "base_color", 0, spp=spp, seed=seed)

        self.unbiased("gradient of the base colour", rendered, measure, known, claim=0.05, spp=1, fixed=True)

    def test_error_falls_with_samples(self) -> None:
        """16 times the samples leave at most a quarter of the noise."""
        declared(self.capabilities.stochastic, "chance")
        few, many = self._mean_square(4), self._mean_square(64)
        excess = difference(Estimate(16.0 * many.mean, 16.0 * many.error, many.freedom), few)
        chance = float(margin(excess) / few.mean)
        message = f"From 4 to 64 samples per pixel variance falls {float(few.mean / many.mean):.1f} times"
        check(float(excess.mean / few.mean) <= chance, f"{message}; wanted 16: are samples repeated?")
        check(chance < 1.0, f"{message}, which is known to {chance:.0%} only: too noisy to tell.")

    def test_backward_samples_are_independent(self) -> None:
        """With `spp_grad` the gradient of the picture squared is unbiased.

        With one sample per pixel, shared samples would add the derivative of the picture's variance: finds 10 %.
        """
        declared("base_color" in self.capabilities.differentiable, "the gradient of base_color")
        case = cases.sheet(size=32, texels=(2, 2))
        rendered, layer = RenderedCase(self.renderer, case), RenderLayer(self.renderer, spp=1, spp_grad=1)
        known = self.known(case, lambda scene: scene.texel_gradients(scene.image())[0], grid=2)
        texture = case.materials[0].base_color

        def measure(spp: int, seed: int) -> Float[ndarray, "*shape"]:
            learned = texture.clone().requires_grad_()
            materials = case.with_map(0, "base_color", learned).materials
            image = layer(rendered.prepared, materials, case.view, seed=seed).image
            (0.5 * image.square()).sum().backward()
            check(learned.grad is not None, "torch has no gradient of the base colour.")
            return numbers(torch.zeros_like(learned) if learned.grad is None else learned.grad)

        self.unbiased("gradient of the squared picture", rendered, measure, known, claim=0.1, spp=1, fixed=True)

    @property
    def _slack(self) -> float:
        return 0.0 if self.renderer.device.type == "cpu" else _ATOMICS

    def _twice(self, one: int, other: int) -> list[tuple[str, ndarray, ndarray]]:
        """The picture and every gradient, with each of two seeds, by renderers of their own."""
        case = cases.rich(self.capabilities.maps)
        wrt, found = cases.differentiable(self.capabilities), []
        for seed in (one, other):
            rendered = RenderedCase(checked(self.make_renderer()), case)
            gradients = flat(rendered.gradients(case.random(), *wrt, seed=seed))
            found.append(
                {"the picture": rendered.image(seed=seed)} | {f"the gradient of {n}": g for n, g in gradients.items()}
            )
        return [(name, found[0][name], found[1][name]) for name in found[0]]

    def _noise(self) -> Float[ndarray, "seeds height width"]:
        """Noise of neighbouring seeds, with mean 0 and variance 1 in each pixel."""
        declared(self.capabilities.stochastic, "chance")
        rendered = RenderedCase(self.renderer, cases.sheet(size=16))
        images = np.stack([rendered.image(seed=seed, spp=4).mean(axis=-1) for seed in range(32)])
        spread = images.std(axis=0, ddof=0)
        check(bool((spread > 0.0).all()), "Some pixels are the same for 32 seeds of a stochastic renderer.")
        return np.asarray((images - images.mean(axis=0)) / spread)

    def _mean_square(self, spp: int) -> Estimate:
        """The noise's variance, over the film, from pairs of seeds."""
        rendered, first = RenderedCase(self.renderer, cases.sheet()), 100 * spp
        pairs = [[rendered.image(spp=spp, seed=first + 2 * i + j) for j in (0, 1)] for i in range(self.count(24))]
        return estimate([np.array(((one - other) ** 2).mean() / 2.0) for one, other in pairs])

    def _unbiased_image(self, spp: int, size: int) -> None:
        case: Case = cases.sheet(size=size)
        rendered = RenderedCase(self.renderer, case)
        known = self.known(case, lambda scene: block_sums(scene.image(), size // 2), grid=2)

        def measure(spp: int, seed: int) -> Float[ndarray, "*shape"]:
            return block_sums(rendered.image(spp=spp, seed=seed), size // 2)

        self.unbiased("image, by quarters", rendered, measure, known, claim=0.05, spp=spp, fixed=True)
