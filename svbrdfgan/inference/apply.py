"""A trained generator on a mesh of one's own."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.config.choices import PartSelection
from svbrdfgan.plugins import load_embedding
from svbrdfgan.scene.asset import Subject, make_subject
from svbrdfgan.training.run import Model
from svbrdfgan.types import Mesh


def paint(
    mesh: Mesh, model: Model, learnable: PartSelection | None = None
) -> tuple[Subject, Float[Tensor, "rows cols channels"]]:
    """The mesh under the embedding and resolution that the model learned on, and the layer that it paints there.

    Args:
        learnable: the parts that carry the layer; those that the training's selection takes, if it is not given.
    """
    learned = model.config.dataset
    embedding = load_embedding(learned.embedding.name, learned.embedding.options)
    subject = make_subject(mesh, embedding, learned.texture, learnable or learned.learnable)
    with torch.no_grad():
        layer = model.generator(subject.geometry.unsqueeze(0))[0]
    return subject, layer
