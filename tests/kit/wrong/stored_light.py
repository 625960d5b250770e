"""Stored light that is weighted, renewed, drawn or differentiated wrongly."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any
from unittest import mock

import torch
from torch import Tensor

from svbrdfgan.rendering.checked_renderer import CheckedLight
from svbrdfgan.types import CHANNELS, View
from wrong.base import Right
from wrong.table import caught_by

Shaded = tuple[Tensor, Callable[[Tensor], Tensor]]


@dataclass(frozen=True, eq=False)
class Shading:
    """What is asked of `shade`. Lights are those of `warp`."""

    lights: tuple[Any, ...]
    textures: Tensor
    maps: tuple[str, ...]
    visit: int
    seed: int

    def channel(self, name: str) -> list[int]:
        """The channels of a map, which may be missing."""
        names = [each for each in self.maps for _ in range(CHANNELS.get(each, 0))]
        return [number for number, each in enumerate(names) if each == name]


class Deferring(Right):
    """A right renderer, whose heirs are wrong in one of the steps of stored light below."""

    def stored(self, prepared: Any, view: View, **how: Any) -> CheckedLight:
        return super().store_light(prepared, view, **how)

    def shaded(self, s: Shading) -> Shaded:
        return super().shade(s.lights, s.textures, maps=s.maps, visit=s.visit, seed=s.seed)

    def slope(self, gradient: Tensor, s: Shading) -> Tensor:
        return gradient

    def store_light(
        self, prepared: Any, view: View, *, learnable: Sequence[int], hits: int, spp: int, seed: int
    ) -> CheckedLight:
        return self.stored(prepared, view, learnable=learnable, hits=hits, spp=spp, seed=seed)

    def shade(
        self, lights: Sequence[CheckedLight], textures: Tensor, *, maps: Sequence[str], visit: int, seed: int
    ) -> Shaded:
        asked = Shading(tuple(lights), textures, tuple(maps), visit, seed)
        images, pullback = self.shaded(asked)
        return images, lambda grad_images: self.slope(pullback(grad_images), asked)


GIVES = "test_stored_light_gives_the_picture"
CLEAR = "test_stored_light_behind_clear_parts_gives_the_picture"


@caught_by(GIVES, CLEAR)
class WeighsKeptHits(Deferring):
    """Each kept hit counts as one camera sample, however many were found."""

    def stored(self, prepared: Any, view: View, **how: Any) -> CheckedLight:
        from svbrdfgan_warp import stored_light

        right = stored_light._kept

        def kept(*args: Any) -> Any:
            hits = right(*args)
            return replace(hits, weight=torch.full_like(hits.weight, 1.0 / how["spp"]))

        with mock.patch.object(stored_light, "_kept", kept):
            return super().stored(prepared, view, **how)


@caught_by(CLEAR)
class StoredLightIsOpaque(Deferring):
    """Where light is stored alpha is ignored."""

    def stored(self, prepared: Any, view: View, **how: Any) -> CheckedLight:
        surface = prepared[0]
        opaque = replace(surface, parts=tuple(replace(part, alpha=1.0) for part in surface.parts))
        return super().stored((opaque, self.right.prepare(opaque)), view, **how)


@caught_by("test_stored_light_is_renewed")
class LightNeverRedrawn(Deferring):
    """Light samples are those of the first visit."""

    def shaded(self, s: Shading) -> Shaded:
        return super().shaded(replace(s, visit=min(s.visit, 0)))


@caught_by("test_stored_light_depends_on_the_visit_alone", "test_stored_light_is_renewed")
class ForgetsSkippedVisits(Deferring):
    """Of visits that were skipped no light is drawn, so that it depends on those before."""

    def shaded(self, s: Shading) -> Shaded:
        for light in s.lights:
            if 0 <= light.value.visit < s.visit:
                light.value.visit = s.visit - 1
        return super().shaded(s)


@caught_by("test_views_of_a_batch_have_their_own_noise")
class RaysSharedByViews(Deferring):
    """All views of a batch take the same random numbers for their rays."""

    def shaded(self, s: Shading) -> Shaded:
        images, right = super().shaded(s)
        parts = s.textures.split([light.learnable for light in s.lights])
        alone = [
            super(RaysSharedByViews, self).shaded(replace(s, lights=(light,), textures=part))
            for light, part in zip(s.lights, parts, strict=True)
        ]

        def pullback(grad_images: Tensor) -> Tensor:
            if grad_images.shape != images.shape:
                return right(grad_images)
            return torch.cat([back(grad[None]) for (_, back), grad in zip(alone, grad_images, strict=True)])

        return torch.cat([image for image, _ in alone]), pullback


@caught_by(GIVES, CLEAR)
class TexturesInReverse(Deferring):
    """The learnable parts of a batch are taken in another order."""

    def shaded(self, s: Shading) -> Shaded:
        return super().shaded(replace(s, textures=s.textures.flip(0)))

    def slope(self, gradient: Tensor, s: Shading) -> Tensor:
        return gradient.flip(0)


@caught_by(GIVES, CLEAR)
class RoughnessForMetallic(Deferring):
    """The channels of roughness and of metallic are exchanged."""

    def shaded(self, s: Shading) -> Shaded:
        return super().shaded(replace(s, textures=self.slope(s.textures, s)))

    def slope(self, gradient: Tensor, s: Shading) -> Tensor:
        roughness, metallic = s.channel("roughness"), s.channel("metallic")
        if not roughness or not metallic or gradient.ndim != 4:
            return gradient
        exchanged = gradient.clone()
        exchanged[..., roughness], exchanged[..., metallic] = gradient[..., metallic], gradient[..., roughness]
        return exchanged


@caught_by("test_gradients_of_stored_light_in_total", late=True)
class StoredRoughnessGradientSteeper(Deferring):
    """The gradient of roughness by stored light is 1 % too large."""

    def slope(self, gradient: Tensor, s: Shading) -> Tensor:
        gradient[..., s.channel("roughness")] *= 1.01
        return gradient


@caught_by("test_gradients_of_stored_light", "test_gradients_of_stored_light_in_total")
class StoredNormalGradientFlipped(Deferring):
    """The gradient of the normal's y by stored light has the wrong sign."""

    def slope(self, gradient: Tensor, s: Shading) -> Tensor:
        gradient[..., s.channel("normal")[1:2]] *= -1.0
        return gradient


@caught_by("test_a_pullback_of_stored_light_is_of_its_picture")
class PullsBackOtherRays(Deferring):
    """The pullback of stored light draws rays of its own."""

    def shaded(self, s: Shading) -> Shaded:
        return super().shaded(s)[0], super().shaded(replace(s, seed=s.seed + 1))[1]


@caught_by("test_a_pullback_of_stored_light_is_of_its_picture")
class PullsBackTheLastVisit(Deferring):
    """The pullback takes the light samples as the last call of `shade` left them."""

    def shaded(self, s: Shading) -> Shaded:
        from svbrdfgan_warp.deferred_shading import ShadingPass

        images, right = super().shaded(s)

        def pullback(grad_images: Tensor) -> Tensor:
            with mock.patch.object(ShadingPass, "_draw_light"):
                return right(grad_images)

        return images, pullback


@caught_by("test_shading_depends_on_its_arguments_alone")
class ShadesWhatIsThereNow(Deferring):
    """The pullback of stored light reads the textures when it is called."""

    def shaded(self, s: Shading) -> Shaded:
        return super().shaded(s)[0], lambda grad_images: super(ShadesWhatIsThereNow, self).shaded(s)[1](grad_images)


@caught_by("test_large_batches_of_stored_light")
class GradientsOfAtMostEightViews(Deferring):
    """Of batches of more than eight views the gradients of the others are those of the first eight again."""

    def slope(self, gradient: Tensor, s: Shading) -> Tensor:
        return gradient[torch.arange(len(gradient)) % 8]


@caught_by("test_large_batches_of_stored_light")
class PicturesOfAtMostEightViews(Deferring):
    """Of batches of more than eight views the others take the textures of the first eight again."""

    def shaded(self, s: Shading) -> Shaded:
        return super().shaded(replace(s, textures=s.textures[torch.arange(len(s.textures)) % 8]))
