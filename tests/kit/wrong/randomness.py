"""Seeds, samples and the settings of the process."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from torch import Tensor

from svbrdfgan.types import Rendering, TransportSamples
from wrong.base import Call, Right, scaled
from wrong.table import SLOPES, caught_by


@caught_by("test_large_seeds")
class SeedsAreShort(Right):
    """Only 32 bits of the seed count."""

    def asked(self, call: Call) -> Call:
        return replace(call, seed=call.seed % 2**32)


@caught_by("test_seeds_are_independent")
class SeedsShareSamples(Right):
    """One bit of the seed is lost, so that some seeds give the same noise."""

    def asked(self, call: Call) -> Call:
        return replace(call, seed=call.seed & ~2)


@caught_by(
    "test_same_seed_same_picture",
    "test_random_seeds_of_the_caller_do_not_matter",
    reason="Both make two renderers.",
)
@dataclass(frozen=True)
class SeedsItself(Right):
    """Each renderer has its own first seed."""

    start: int = field(default_factory=itertools.count().__next__)

    def asked(self, call: Call) -> Call:
        return replace(call, seed=call.seed + 7919 * self.start)


@caught_by("test_random_generators_are_left_alone")
class SeedsTorch(Right):
    """torch's global generator is seeded."""

    def asked(self, call: Call) -> Call:
        torch.manual_seed(call.seed)
        return call


@caught_by("test_random_seeds_of_the_caller_do_not_matter")
class ReadsTorchsSeed(Right):
    """The seed of torch's global generator counts as well."""

    def asked(self, call: Call) -> Call:
        return replace(call, seed=call.seed + torch.initial_seed() % 2**31)


@caught_by("test_settings_of_torch_and_numpy_are_left_alone")
class DoublesByDefault(Right):
    """torch's default dtype is changed."""

    def asked(self, call: Call) -> Call:
        torch.set_default_dtype(torch.float64)
        return call


@caught_by(
    "test_one_sample_is_unbiased",
    "test_backward_samples_are_independent",
    reason="A loss and its gradient at one sample are wrong with the picture.",
)
class DarkPicturesOfOneSample(Right):
    """Pictures of one sample per pixel are 20 % too dark, as where bright samples are cut off."""

    def picture(self, rendering: Rendering, call: Call) -> Rendering:
        return scaled(rendering, 0.8) if call.spp == 1 else rendering


@caught_by(
    "test_gradients_of_one_sample_are_unbiased",
    "test_backward_samples_are_independent",
    reason="A loss and its gradient at one sample are wrong with this.",
)
class FlatGradientsOfOneSample(Right):
    """Gradients of one sample per pixel are 20 % too small, as where bright samples are cut off."""

    def cotangent(self, grad_image: Tensor, call: Call) -> Tensor:
        return grad_image * 0.8 if call.spp == 1 else grad_image


@caught_by("test_pixels_are_independent")
class PixelsShareTheirNoise(Right):
    """All pixels have 4 % of their noise in common, as where they use the same random numbers."""

    def picture(self, rendering: Rendering, call: Call) -> Rendering:
        return scaled(rendering, self.noise(call))

    def cotangent(self, grad_image: Tensor, call: Call) -> Tensor:
        return grad_image * self.noise(call)

    def samples(self, samples: TransportSamples, call: Call) -> TransportSamples:
        return replace(samples, weight=samples.weight * self.noise(call))

    def noise(self, call: Call) -> float:
        """Of the picture as a whole, on average 1; where nobody looks for other things."""
        return 1.0 + 0.04 * np.random.default_rng(call.seed).normal() if call.spp == 4 else 1.0


@caught_by("test_error_falls_with_samples", whole=True, reason="Whole pictures stay too noisy to tell.")
class AtMostSixteenSamples(Right):
    """At most 16 samples per pixel are taken, however many are asked for."""

    def asked(self, call: Call) -> Call:
        return replace(call, spp=min(call.spp, 16))


@caught_by(
    *SLOPES,
    "test_transport_transposed_is_the_gradient",
    "test_environment_sums_to_the_picture",
    reason="On average it is right, but not for the picture's own seed.",
)
class GradientOfOtherSamples(Right):
    """Gradients are those of another seed's picture."""

    def asked(self, call: Call) -> Call:
        return replace(call, seed=call.seed + 1_000_003) if call.wrt else call


@caught_by("test_backward_samples_are_independent")
@dataclass(frozen=True)
class GradientOfTheLastPicture(Right):
    """Gradients take the samples of the last picture, whatever their seed."""

    last: dict[int, int] = field(default_factory=dict)

    def asked(self, call: Call) -> Call:
        if call.wrt:
            return replace(call, seed=self.last.get(call.spp, call.seed))
        self.last[call.spp] = call.seed
        return call
