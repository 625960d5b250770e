"""Parts that rays pass through otherwise than their alpha says."""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
import torch
from svbrdfgan_numpy.integrator import PathTracer

from svbrdfgan.types import Rendering, Surface
from wrong.base import Call, OnNumpy, Patch, Patched, slow_renderer
from wrong.table import caught_by

_LIDS = ("test_a_clear_lid_casts_a_part_of_a_shadow", "test_two_clear_lids_cast_the_product")
_SEEN = (
    "test_coverage_of_a_clear_part_is_its_alpha",
    "test_a_clear_part_shows_what_is_behind",
    "test_alpha_lies_as_textures",
)


@caught_by("test_without_alpha_parts_are_opaque")
class AlphaUndeclared(OnNumpy):
    """Rays pass by alpha, and it does not say so."""

    claims = MappingProxyType({"alpha": False})


@caught_by(*_SEEN, *_LIDS, "test_paths_pass_what_is_not_there", whole=True, reason="In pictures and shadows.")
class AlphaIgnored(OnNumpy):
    """Every part is opaque, and it says otherwise."""

    def surface(self, surface: Surface) -> Surface:
        return replace(surface, parts=tuple(replace(part, alpha=1.0) for part in surface.parts))


@caught_by(*_SEEN, *_LIDS, whole=True, reason="In pictures and shadows.")
class AlphaSquared(OnNumpy):
    """Alpha counts twice."""

    def surface(self, surface: Surface) -> Surface:
        return replace(surface, parts=tuple(replace(part, alpha=part.alpha * part.alpha) for part in surface.parts))


@caught_by(*_SEEN, *_LIDS, whole=True, reason="In pictures and shadows.")
class AlphaOrNot(OnNumpy):
    """Alpha is cut off at one half."""

    def surface(self, surface: Surface) -> Surface:
        cut = [np.asarray(part.alpha) for part in surface.parts]
        parts = zip(surface.parts, cut, strict=True)
        return replace(
            surface, parts=tuple(replace(p, alpha=(a >= 0.5) + 0.0 if a.ndim else float(a >= 0.5)) for p, a in parts)
        )


@caught_by("test_alpha_lies_as_textures", whole=True)
class AlphaUpsideDown(OnNumpy):
    """Row 0 of an alpha texture is on top, as in picture files."""

    def surface(self, surface: Surface) -> Surface:
        parts = [(part, np.asarray(part.alpha)) for part in surface.parts]
        flipped = tuple(replace(part, alpha=alpha[::-1]) if alpha.ndim else part for part, alpha in parts)
        return replace(surface, parts=flipped)


class Searching(Patched):
    """Its heirs pass some rays otherwise."""

    def opaque(self, stage: int) -> bool:
        """Whether rays stop at every part: 0 from the camera, 2 and 4 to the light, 3 and 5 as paths go on."""
        raise NotImplementedError

    def patches(self) -> list[Patch]:
        right = PathTracer._search

        def search(tracer: Any, origin: Any, direction: Any, rays: Any, *, any_hit: bool = False) -> Any:
            if self.opaque(rays.stage):
                tracer = replace(tracer, prepared=replace(tracer.prepared, transparency=None))
            return right(tracer, origin, direction, rays, any_hit=any_hit)

        return [(PathTracer, "_search", search)]


@caught_by(*_LIDS, "test_a_clear_part_shows_what_is_behind", whole=True, reason="Sheets shadow one another.")
class ShadowsOfWhatIsClear(Searching):
    """Camera rays pass by alpha, and no others."""

    def opaque(self, stage: int) -> bool:
        return stage > 0


@caught_by("test_paths_pass_what_is_not_there")
class PathsStopAtWhatIsClear(Searching):
    """Camera rays and rays to the light pass by alpha, and paths do not."""

    bounces = 2

    def opaque(self, stage: int) -> bool:
        return stage % 2 == 1


@caught_by("test_a_clear_part_shows_what_is_behind", whole=True)
class AlphaTinted(OnNumpy):
    """What is seen through the first part takes its colour."""

    def picture(self, rendering: Rendering, call: Call) -> Rendering:
        first = call.materials.parts[0]
        if first.base_color.ndim > 1 or call.surface.parts[0].opaque:
            return rendering
        black = replace(first, maps={**first.maps, "base_color": torch.zeros(3)})
        materials = replace(call.materials, parts=(black, *call.materials.parts[1:]))
        behind = self.right.render(call.prepared, materials, call.view, spp=call.spp, seed=call.seed).image
        return replace(rendering, image=rendering.image - behind + behind * first.base_color)


@caught_by("test_coverage_of_a_clear_part_is_its_alpha", "test_alpha_lies_as_textures", whole=False)
class ClearCoversWhole(OnNumpy):
    """What is seen at all covers the pixel, however clear it is."""

    claims = MappingProxyType({"transport": False})

    def picture(self, rendering: Rendering, call: Call) -> Rendering:
        opaque = replace(call.surface, parts=tuple(replace(part, alpha=1.0) for part in call.surface.parts))
        right = slow_renderer(1)
        whole = right.render(right.prepare(opaque), call.materials, call.view, spp=call.spp, seed=call.seed)
        return replace(rendering, coverage=whole.coverage)
