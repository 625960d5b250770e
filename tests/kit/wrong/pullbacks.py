"""Pullbacks that are not the gradient, or remember what they should not."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import torch
from torch import Tensor

from svbrdfgan.protocols import Pullback
from svbrdfgan.types import Gradients, Materials, Rendering, View
from wrong.base import Right
from wrong.table import caught_by


@caught_by("test_pullback_is_the_gradient", "test_render_layer_gives_torch_these_gradients")
class PullsBackOtherSamples(Right):
    """The pullback traces samples of its own."""

    def render_pullback(self, *scene: Any, wrt: frozenset[str], spp: int, seed: int) -> tuple[Rendering, Pullback]:
        _, pullback = super().render_pullback(*scene, wrt=wrt, spp=spp, seed=seed + 1)
        return self.render(*scene, spp=spp, seed=seed), pullback


@caught_by("test_pullback_is_the_gradient")
class PullsBackOtherColors(Right):
    """Likewise, where the base colour alone is wanted."""

    def render_pullback(self, *scene: Any, wrt: frozenset[str], spp: int, seed: int) -> tuple[Rendering, Pullback]:
        _, pullback = super().render_pullback(*scene, wrt=wrt, spp=spp, seed=seed + (wrt == {"base_color"}))
        return self.render(*scene, spp=spp, seed=seed), pullback


@caught_by("test_pullback_is_the_gradient")
class PullsBackOnce(Right):
    """A pullback's second gradient has the first one in it."""

    def render_pullback(self, *scene: Any, wrt: frozenset[str], spp: int, seed: int) -> tuple[Rendering, Pullback]:
        rendering, right = super().render_pullback(*scene, wrt=wrt, spp=spp, seed=seed)
        asked: list[Tensor] = []

        def pullback(grad_image: Tensor) -> Gradients:
            asked.append(grad_image)
            return right(torch.stack(asked).sum(dim=0))

        return rendering, pullback


class PullsBack(Right):
    """A right renderer, whose heirs change what its pullback is given or shows."""

    def render_pullback(
        self, prepared: Any, materials: Materials, view: View, *, wrt: frozenset[str], spp: int, seed: int
    ) -> tuple[Rendering, Pullback]:
        asked = self.known_wrt(wrt)
        rendering, right = super().render_pullback(prepared, materials, view, wrt=asked, spp=spp, seed=seed)
        return self.shown(rendering, materials), right

    def known_wrt(self, wrt: frozenset[str]) -> frozenset[str]:
        return wrt

    def shown(self, rendering: Rendering, materials: Materials) -> Rendering:
        return rendering


@caught_by("test_gradients_are_of_what_is_asked")
class PullsBackEverything(PullsBack):
    """All gradients are given, asked for or not."""

    def known_wrt(self, wrt: frozenset[str]) -> frozenset[str]:
        return wrt | self.capabilities.differentiable


@caught_by("test_results_carry_no_autograd_graph")
class PullsBackAGraph(PullsBack):
    """The picture beside its pullback has a graph."""

    def shown(self, rendering: Rendering, materials: Materials) -> Rendering:
        graph = any(value.requires_grad for m in materials.parts for value in m.maps.values())
        return replace(rendering, image=rendering.image.requires_grad_(graph))


@caught_by("test_a_pullback_keeps_what_it_was_given")
class PullsBackWhatIsThereNow(Right):
    """Its pullback reads textures and light when it is called."""

    def kept(self, materials: Materials, view: View) -> tuple[Materials, View]:
        return materials, view


@caught_by("test_memory_does_not_grow")
@dataclass(frozen=True)
class KeepsItsPullbacks(PullsBack):
    """What was traced for a pullback is kept for good."""

    past: list[Tensor] = field(default_factory=list)

    def shown(self, rendering: Rendering, materials: Materials) -> Rendering:
        self.past.append(rendering.image.clone())
        return rendering
