"""Pictures of the demo's layer on glossy paint: the dirt's colour and place are learned, all gloss is declared here."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.evaluation.evaluated import Evaluated
from svbrdfgan.metrics.flip import display
from svbrdfgan.rendering.checked_renderer import CheckedRenderer
from svbrdfgan.rendering.compositing import bare_maps
from svbrdfgan.report.pictures import Picture, framed
from svbrdfgan.scene.subject import Subject

PAINT: Mapping[str, float] = MappingProxyType({"roughness": 0.1, "metallic": 0.0})
"""Clean paint, as `Subject.materials` takes it: as smooth as a clear coat."""
_DIRT = (0.9, 0.0)
"""Roughness and metallic of dirt. The recipe `road-dirt` paints a roughness from 0.85 to 0.95."""
_POLISHED: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "glass": {"roughness": 0.05, "metallic": 0.0},
        "lights_front": {"roughness": 0.1, "metallic": 0.0},
        "lights_rear": {"roughness": 0.1, "metallic": 0.0},
        "rim": {"roughness": 0.3, "metallic": 1.0},
    }
)
"""Parts of procedural vehicles that carry no layer; the others stay Lambertian."""
_SCALE = 3  # pictures are larger than the exemplars
_SPP = 48  # and need more samples, since highlights are small and bright


def polished(subject: Subject) -> Subject:
    """The subject of a procedural vehicle with gloss on glass, lights and rims, as if its file said so."""
    names = [part.name.removesuffix(" (hidden)") for part in subject.surface.parts]
    return replace(subject, file_maps=tuple(bare_maps(_POLISHED.get(name, {})) for name in names))


def matt_dirt(layer: Float[Tensor, "rows cols 4"]) -> Float[Tensor, "rows cols 6"]:
    """An RGBA layer with the roughness and metallic of dirt, under the same alpha."""
    return torch.cat([layer, layer.new_tensor(_DIRT).expand(*layer.shape[:2], -1)], dim=-1)


def glossy_picture(evaluated: Evaluated, renderer: CheckedRenderer, index: int) -> Picture:
    """An exemplar's scene under the learned layer, its paint glossy."""
    exemplars = evaluated.source.exemplars
    scene, subject = exemplars.scenes[index], polished(exemplars.subject(index))
    layer = evaluated.learned(index)
    view = exemplars.loader.view(scene)
    larger = replace(view, width=_SCALE * view.width, height=_SCALE * view.height)
    materials = subject.materials(scene.materials, matt_dirt(layer), PAINT)
    made = renderer.render(renderer.prepare(subject.surface), materials, larger, spp=_SPP, seed=scene.seed)
    coverage = made.coverage.cpu()
    return framed(display(made.image.cpu(), coverage=coverage), coverage)
