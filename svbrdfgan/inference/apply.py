"""Applies a trained generator to a mesh."""

from __future__ import annotations

import logging

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.config.choices import PartSelection
from svbrdfgan.errors import ConfigError
from svbrdfgan.networks import Draw
from svbrdfgan.networks.random_fields import MOST_SEEDS
from svbrdfgan.plugins import load_embedding
from svbrdfgan.scene.subject import Subject, make_subject
from svbrdfgan.training.run import Model
from svbrdfgan.types import Mesh

log = logging.getLogger(__name__)


def paint(
    mesh: Mesh,
    model: Model,
    learnable: PartSelection | None = None,
    *,
    seed: int | None = None,
    amount: float | None = None,
    recipe: str | None = None,
) -> tuple[Subject, Float[Tensor, "rows cols channels"]]:
    """The mesh with the embedding and texture resolution of the training, and the layer that the model paints on it.

    Args:
        learnable: the parts that carry the layer; by default those that the training's selection matches.
        seed: of a model with chance: which of its layers; by default 0.
        amount: of a model that knows amounts, in [0, 1]; by default the middle of those that it was trained on.
        recipe: of a model of several recipes, which it must be told.

    Raises:
        ConfigError: the model has no chance, or does not know what is asked for.
        EmbeddingError: the mesh cannot be embedded.
        AssetError: no part that can be seen is learnable.
    """
    draw = choose_draw(model, seed=seed, amount=amount, recipe=recipe)
    subject = prepare(mesh, model, learnable)
    return subject, paint_draw(subject, draw)


def choose_draw(
    model: Model, *, seed: int | None = None, amount: float | None = None, recipe: str | None = None
) -> Draw:
    """One draw of the model's distribution; see `paint`.

    Raises:
        ConfigError: the model has no chance, or does not know what is asked for.
    """
    if seed is not None and not 0 <= seed < MOST_SEEDS:
        raise ConfigError(f"seed {seed} is not allowed; wanted a whole number from 0 to {MOST_SEEDS - 1}.")
    if seed is not None and not model.generator.chance:
        raise ConfigError(
            "the model has no chance, and so paints one layer on a mesh: leave out --seed and --count, or train with "
            "generator.chance on exemplars of different seeds."
        )
    known = model.config.conditions
    labels = known.choose(amount, recipe)
    if amount is not None and known.amount is not None and not known.amount[0] <= amount <= known.amount[1]:
        log.warning("amount %g is beyond those that the model was trained on: %g to %g", amount, *known.amount)
    return Draw(model.generator, seed or 0, labels)


def prepare(mesh: Mesh, model: Model, learnable: PartSelection | None = None) -> Subject:
    """The mesh as the model's training saw its meshes; see `paint`."""
    trained = model.config.dataset
    embedding = load_embedding(trained.embedding.name, trained.embedding.options)
    return make_subject(mesh, embedding, trained.texture, learnable or trained.learnable, file_maps=bool(trained.maps))


def paint_draw(subject: Subject, draw: Draw) -> Float[Tensor, "rows cols channels"]:
    """The layer of a draw on a subject."""
    with torch.no_grad():
        return draw(subject.geometry.unsqueeze(0))[0]
