"""Applies a trained generator to a mesh."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.config.choices import PartSelection
from svbrdfgan.errors import ConfigError
from svbrdfgan.geometry.bake import bake
from svbrdfgan.geometry.layers import embed_and_rasterize
from svbrdfgan.geometry.texels import nearest_texels
from svbrdfgan.networks.draw import Draw, opacity_of
from svbrdfgan.networks.random_fields import MOST_SEEDS
from svbrdfgan.plugins.registry import load_embedding
from svbrdfgan.scene.subject import Subject, make_subject
from svbrdfgan.training.run import Model
from svbrdfgan.types import Layer, Mesh

log = logging.getLogger(__name__)

FINEST = 4096
"""The most texels along a side that a layer can be painted at: textures beyond it are more than viewers take."""


@dataclass(frozen=True, eq=False)
class Canvas:
    """A mesh ready to be painted on.

    Attributes:
        subject: at the resolution of the layer.
        geometry: the generator's input.
        factor: the resolution of the layer over that of the geometry.
        share: what alpha is multiplied by at each texel of the layer; None is 1.
    """

    subject: Subject
    geometry: Float[Tensor, "inputs coarse_rows coarse_cols"]
    factor: int
    share: Float[Tensor, "rows cols 1"] | None = None

    def paint(self, draw: Draw) -> Layer:
        """The layer of a draw."""
        with torch.no_grad():
            values = draw(self.geometry.unsqueeze(0), self.factor)[0]
            if self.share is not None:
                values[..., draw.generator.channels["alpha"]] *= self.share
            return Layer(values, draw.generator.maps)

    def thinned(self, shares: Float[Tensor, " mesh_faces"]) -> Canvas:
        """The same, where alpha is multiplied by the share of the face that each texel shows."""
        face = self.subject.buffer.face.numpy()
        nearest = face[nearest_texels(face >= 0)]
        return replace(self, share=shares[self.subject.surface.source_face[nearest]][..., None])


def paint(
    mesh: Mesh,
    model: Model,
    learnable: PartSelection | None = None,
    *,
    seed: int | None = None,
    amount: float | None = None,
    recipe: str | None = None,
    resolution: int | None = None,
) -> tuple[Subject, Layer]:
    """The mesh with the embedding of the training, and the layer that the model paints on it.

    Args:
        learnable: the parts that carry the layer; by default those that the training's selection matches.
        seed: of a model with random fields: which of its layers; by default 0.
        amount: of a model that knows amounts, in [0, 1], and 0 is clean; by default the middle of those that it was
            trained on.
        recipe: of a model of several recipes, which needs it.
        resolution: texels along a side of the layer and of the subject's textures, a multiple of those that the model
            was trained at, and at most `FINEST`; by default those. Patterns keep their scale (`Generator.forward`).

    Raises:
        ConfigError: the model has no random fields, or does not know what is asked for, or cannot paint at that
            resolution, or there is not enough memory for it.
        EmbeddingError: the mesh cannot be embedded.
        AssetError: no part that can be seen is learnable.
    """
    draw = choose_draw(model, seed=seed, amount=amount, recipe=recipe)
    with explain_memory(resolution):
        canvas = prepare(mesh, model, learnable, resolution)
        return canvas.subject, canvas.paint(draw)


def choose_draw(
    model: Model, *, seed: int | None = None, amount: float | None = None, recipe: str | None = None
) -> Draw:
    """One draw of the model's distribution; see `paint`.

    Raises:
        ConfigError: the model has no random fields, or does not know what is asked for.
    """
    if seed is not None and not 0 <= seed < MOST_SEEDS:
        raise ConfigError(f"seed {seed} is not allowed; wanted a whole number from 0 to {MOST_SEEDS - 1}.")
    if seed is not None and not model.generator.random_fields:
        raise ConfigError(
            "the model has no random fields, and so paints one layer on a mesh: ask for no seed and no count, or "
            "train with generator.random_fields on exemplars of different seeds."
        )
    known = model.config.conditions
    labels = known.choose(amount, recipe)
    if amount and known.amount is not None and not known.amount[0] <= amount <= known.amount[1]:
        log.warning("amount %g is beyond those that the model was trained on: %g to %g", amount, *known.amount)
    return Draw(model.generator, seed or 0, labels, 1.0 if amount is None else opacity_of(amount), model.windows)


def prepare(mesh: Mesh, model: Model, learnable: PartSelection | None = None, resolution: int | None = None) -> Canvas:
    """The mesh as the model's training saw its meshes, to be painted at a resolution; see `paint`.

    Raises:
        ConfigError: the model cannot paint at that resolution.
    """
    trained = model.config.dataset
    factor = finer_factor(model, resolution)
    embedding = load_embedding(trained.embedding.name, trained.embedding.options)
    subject = make_subject(
        mesh, embedding, factor * model.geometry_texels, learnable or trained.learnable, file_maps=bool(trained.maps)
    )
    if factor == 1:
        read = subject
    else:  # baked again: for even factors no texel of the finer buffer lies at the centre of a coarser one
        fragments = embed_and_rasterize(embedding, mesh, model.geometry_texels)
        read = replace(subject, surface=fragments.surface, buffer=bake(fragments))
    if model.generator.mesh_maps:
        read = read.with_mesh_maps()
    return Canvas(subject, read.generator_input, factor)


def finer_factor(model: Model, resolution: int | None) -> int:
    """The factor by which a layer's resolution, None for that of the training, is finer than that of its geometry.

    Raises:
        ConfigError: the resolution is not a multiple of the trained one, or greater than `FINEST`.
    """
    trained = model.config.dataset.texture
    resolution = trained if resolution is None else resolution
    if resolution % trained or not trained <= resolution <= max(trained, FINEST):
        raise ConfigError(
            f"resolution {resolution} is not allowed; the model was trained at {trained} texels, so wanted a multiple "
            f"of {trained} from {trained} to {max(trained, FINEST // trained * trained)}."
        )
    return resolution // model.geometry_texels


@contextmanager
def explain_memory(resolution: int | None) -> Iterator[None]:
    """Says what to do if memory runs out at a resolution that was asked for.

    Raises:
        ConfigError: memory ran out. (Linux may also end the process without a word.)
    """
    try:
        yield
    except (MemoryError, RuntimeError) as error:
        # torch has no exception of its own for the CPU's memory
        lacking = isinstance(error, MemoryError | torch.cuda.OutOfMemoryError) or "DefaultCPUAllocator" in str(error)
        if resolution is None or not lacking:
            raise
        raise ConfigError(f"there is not enough memory for resolution {resolution}; choose a smaller one.") from error
