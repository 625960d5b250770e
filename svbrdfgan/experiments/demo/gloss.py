"""Pictures of the demo's layer on glossy paint: the dirt's colour and place are learned, all gloss is declared here."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import torch

from svbrdfgan.evaluation.evaluated import Evaluated
from svbrdfgan.metrics.flip import display
from svbrdfgan.rendering.checked_renderer import CheckedRenderer
from svbrdfgan.rendering.compositing import bare_maps
from svbrdfgan.report.pictures import Picture, framed
from svbrdfgan.scene.subject import Subject
from svbrdfgan.types import Layer

PAINT: Mapping[str, float] = MappingProxyType({"roughness": 0.1, "metallic": 0.0})
"""Clean paint, as `Subject.materials` takes it: as smooth as a clear coat."""
_DIRT = (0.9, 0.0)
"""Roughness and metallic of dirt. The recipe `smooth-dirt` paints a roughness from 0.85 to 0.95."""
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
    parts = subject.surface.parts
    return replace(subject, file_maps=tuple(bare_maps(_POLISHED.get(part.mesh_part, {})) for part in parts))


def matt_dirt(layer: Layer) -> Layer:
    """A layer of base colour alone with the roughness and metallic of dirt, under the same alpha."""
    dirt = layer.values.new_tensor(_DIRT).expand(*layer.values.shape[:-1], -1)
    return Layer(torch.cat([layer.rgba, dirt], dim=-1), tuple(PAINT))


def glossy_picture(evaluated: Evaluated, renderer: CheckedRenderer, index: int) -> Picture:
    """An exemplar's scene under the learned layer, its paint glossy."""
    exemplars = evaluated.source.exemplars
    scene, subject = exemplars.scenes[index], polished(exemplars.subject(index))
    layer = evaluated.learned(index)
    view = exemplars.loader.view(scene)
    larger = replace(view, width=_SCALE * view.width, height=_SCALE * view.height)
    materials = subject.materials(matt_dirt(layer), PAINT, base_colors=scene.materials)
    made = renderer.render(renderer.prepare(subject.surface), materials, larger, spp=_SPP, seed=scene.seed)
    coverage = made.coverage.cpu()
    return framed(display(made.image.cpu(), coverage=coverage), coverage)
