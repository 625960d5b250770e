"""Applies a trained generator to a mesh."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.config.choices import PartSelection
from svbrdfgan.plugins import load_embedding
from svbrdfgan.scene.subject import Subject, make_subject
from svbrdfgan.training.run import Model
from svbrdfgan.types import Mesh


def paint(
    mesh: Mesh, model: Model, learnable: PartSelection | None = None
) -> tuple[Subject, Float[Tensor, "rows cols channels"]]:
    """The mesh with the embedding and texture resolution of the training, and the layer that the model paints on it.

    Args:
        learnable: the parts that carry the layer; by default those that the training's selection matches.
    """
    trained = model.config.dataset
    embedding = load_embedding(trained.embedding.name, trained.embedding.options)
    subject = make_subject(
        mesh, embedding, trained.texture, learnable or trained.learnable, file_maps=bool(trained.maps)
    )
    with torch.no_grad():
        layer = model.generator(subject.geometry.unsqueeze(0))[0]
    return subject, layer
