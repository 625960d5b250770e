"""Pictures of the demo's layer on glossy paint: the dirt's colour and place are learned, its roughness is declared.

The gloss of the vehicles and the alpha of their glass are those of their files.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import torch

from svbrdfgan.data.config import DatasetConfig
from svbrdfgan.evaluation.evaluated import Evaluated
from svbrdfgan.io.mesh import load_mesh
from svbrdfgan.metrics.flip import display
from svbrdfgan.plugins.registry import load_embedding
from svbrdfgan.rendering.checked_renderer import CheckedRenderer
from svbrdfgan.report.pictures import Picture, framed
from svbrdfgan.scene.subject import Subject, make_subject
from svbrdfgan.types import Layer, Mesh

GLOSS: Mapping[str, None] = MappingProxyType({"roughness": None, "metallic": None})
"""The maps of the files' own values, as `Subject.materials` takes them."""
_DIRT = (0.9, 0.0)
"""Roughness and metallic of dirt. The recipe `smooth-dirt` paints a roughness from 0.85 to 0.95."""
_SCALE = 3  # pictures are larger than the exemplars
_SPP = 48  # and need more samples, since highlights are small and bright


def glossy(mesh: Mesh, trained: DatasetConfig, resolution: int | None = None) -> Subject:
    """The subject of a mesh as training saw it, but with the gloss and the glass of its file.

    Args:
        resolution: texels along a side; by default those of the training.
    """
    embedding = load_embedding(trained.embedding.name, trained.embedding.options)
    return make_subject(mesh, embedding, resolution or trained.texture, trained.learnable, file_maps=True)


def matt_dirt(layer: Layer) -> Layer:
    """A layer of base colour alone with the roughness and metallic of dirt, under the same alpha."""
    dirt = layer.values.new_tensor(_DIRT).expand(*layer.values.shape[:-1], -1)
    return Layer(torch.cat([layer.rgba, dirt], dim=-1), tuple(GLOSS))


def glossy_picture(evaluated: Evaluated, renderer: CheckedRenderer, index: int) -> Picture:
    """An exemplar's scene under the learned layer, on a vehicle with the gloss and the glass of its file."""
    scene, loader = evaluated.source.exemplars.scenes[index], evaluated.source.exemplars.loader
    subject, view = glossy(load_mesh(loader.file(scene.mesh)), evaluated.config.dataset), loader.view(scene)
    larger = replace(view, width=_SCALE * view.width, height=_SCALE * view.height)
    materials = subject.materials(matt_dirt(evaluated.learned(index)), GLOSS, base_colors=scene.materials)
    made = renderer.render(renderer.prepare(subject.surface), materials, larger, spp=_SPP, seed=scene.seed)
    coverage = made.coverage.cpu()
    return framed(display(made.image.cpu(), coverage=coverage), coverage)
