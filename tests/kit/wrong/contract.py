"""Transport, records, types, and memory."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from torch import Tensor

from svbrdfgan.protocols import RendererCapabilities
from svbrdfgan.types import Gradients, Rendering, TransportSamples, View
from wrong.base import Call, Right, light_of, scaled
from wrong.table import caught_by


@caught_by(
    "test_transport_has_a_record_for_each_sample_that_met_the_surface",
    "test_transport_times_texture_is_the_picture",
    reason="Both count records; the second in shadow.",
)
class TransportForgetsTheDark(Right):
    """Samples that no light reaches are left out."""

    def samples(self, samples: TransportSamples, call: Call) -> TransportSamples:
        lit = (samples.weight > 0.0).any(dim=1)
        return TransportSamples(samples.pixel[lit], samples.part[lit], samples.uv[lit], samples.weight[lit])


@caught_by(
    "test_transport_has_a_record_for_each_sample_that_met_the_surface",
    "test_transport_times_texture_is_the_picture",
    "test_transport_transposed_is_the_gradient",
    reason="Its samples miss and meet the surface elsewhere, with other weights.",
)
class TransportOfAnotherSeed(Right):
    """Transport takes samples of its own."""

    def transport(self, prepared: Any, view: View, *, spp: int, seed: int) -> Iterator[TransportSamples]:
        return super().transport(prepared, view, spp=spp, seed=seed + 1)


@caught_by(
    "test_transport_times_texture_is_the_picture",
    "test_transport_transposed_is_the_gradient",
    reason="The same product, and its transpose.",
)
class TransportNotDivided(Right):
    """Weights are not divided by the sample count."""

    def samples(self, samples: TransportSamples, call: Call) -> TransportSamples:
        return replace(samples, weight=samples.weight * call.spp)


@caught_by("test_gradients_are_of_what_is_asked")
class DifferentiatesEverything(Right):
    """All gradients are given, asked for or not."""

    def asked(self, call: Call) -> Call:
        return replace(call, wrt=call.wrt | {"base_color"} if call.wrt else call.wrt)


@caught_by("test_inputs_are_only_read")
class SpoilsTheCotangent(Right):
    """The gradient of the picture is used up."""

    def cotangent(self, grad_image: Tensor, call: Call) -> Tensor:
        used = grad_image.clone()
        grad_image.zero_()
        return used


@caught_by("test_capabilities_are_a_constant_record")
@dataclass(frozen=True)
class FindsOutLater(Right):
    """Capabilities depend on what was rendered before."""

    past: list[int] = field(default_factory=list)

    @property
    def capabilities(self) -> RendererCapabilities:
        right = self.right.capabilities
        return replace(right, max_bounces=2 if self.past else 1)

    def asked(self, call: Call) -> Call:
        self.past.append(call.seed)
        return call


@caught_by("test_it_pickles")
class HoldsAFunction(Right):
    """It cannot be pickled."""

    def __init__(self) -> None:
        object.__setattr__(self, "rule", lambda call: call)


@caught_by("test_its_repr_is_one_line")
class Nameless(Right):
    """Its repr does not say what it is."""

    def __repr__(self) -> str:
        return "<renderer>"


@caught_by(
    "test_pictures_are_shaped_as_the_film",
    "test_settings_of_the_caller_do_not_matter",
    reason="The second asks for single precision under double as well.",
)
class DoublePictures(Right):
    """Pictures are double precision."""

    def picture(self, rendering: Rendering, call: Call) -> Rendering:
        return replace(rendering, image=rendering.image.double())


@caught_by("test_gradients_are_shaped_as_the_maps", "test_many_parts", reason="Both look at dtypes.")
class DoubleGradients(Right):
    """The environment's gradient is double precision."""

    def gradient(self, gradients: Gradients, call: Call) -> Gradients:
        return light_of(gradients, lambda light: light.double())


@caught_by("test_memory_does_not_grow", "test_nothing_stays_of_a_render")
@dataclass(frozen=True)
class KeepsItsInputs(Right):
    """Every texture is kept."""

    past: list[Tensor] = field(default_factory=list)

    def asked(self, call: Call) -> Call:
        self.past.extend(material.base_color.detach().double() for material in call.materials.parts)
        return call


@caught_by("test_memory_does_not_grow", "test_nothing_stays_of_a_render")
@dataclass(frozen=True)
class KeepsItsPictures(Right):
    """Every picture is kept."""

    past: list[Tensor] = field(default_factory=list)

    def picture(self, rendering: Rendering, call: Call) -> Rendering:
        self.past.append(rendering.image.clone())
        return rendering


@caught_by("test_nothing_stays_of_a_render")
@dataclass(frozen=True)
class LeaksAKilobyte(Right):
    """A kilobyte is lost with each picture."""

    past: list[bytes] = field(default_factory=list)

    def picture(self, rendering: Rendering, call: Call) -> Rendering:
        self.past.append(bytes(1024))
        return rendering


@caught_by("test_nothing_stays_of_a_render")
@dataclass(frozen=True)
class LeaksAHundredBytes(Right):
    """104 bytes of the C library are lost with each picture. Of Python's own small objects six are found."""

    past: list[Any] = field(default_factory=list)

    def picture(self, rendering: Rendering, call: Call) -> Rendering:
        self.past.append(np.empty(104, dtype=np.uint8))
        return rendering


@caught_by("test_nothing_stays_of_a_render")
@dataclass(frozen=True)
class LeaksFiles(Right):
    """A file is left open with each picture."""

    past: list[int] = field(default_factory=list)

    def picture(self, rendering: Rendering, call: Call) -> Rendering:
        self.past.append(os.open(os.devnull, os.O_RDONLY))
        return rendering

    def __del__(self) -> None:
        for file in self.past:
            os.close(file)


@caught_by("test_nothing_stays_of_a_render")
@dataclass(frozen=True)
class LeaksThreads(Right):
    """A thread is left waiting with each picture, while the renderer exists."""

    done: Any = field(default_factory=threading.Event, repr=False)

    def __reduce__(self) -> Any:
        return LeaksThreads, ()

    def picture(self, rendering: Rendering, call: Call) -> Rendering:
        threading.Thread(target=self.done.wait, args=(20.0,), daemon=True).start()
        return rendering


@caught_by("test_two_threads_may_render_at_once")
@dataclass(frozen=True)
class SharedByThreads(Right):
    """What a picture is made of is kept where another thread puts its own."""

    last: list[View] = field(default_factory=list)

    def asked(self, call: Call) -> Call:
        self.last[:] = [call.view]
        return call

    def picture(self, rendering: Rendering, call: Call) -> Rendering:
        return rendering if self.last == [call.view] else scaled(rendering, 0.5)
