"""Batches of scenes that fakes are rendered in: what all ways of rendering them have in common."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, Protocol

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.rendering.checked_renderer import CheckedRenderer
from svbrdfgan.types import Layer
from svbrdfgan.types.layer import RGBA

Layers = Float[Tensor, "batch rows cols channels"]
Images = Float[Tensor, "batch height width 3"]
Coverage = Float[Tensor, "batch height width"]


SceneKey = tuple[int, int]
"""The index of an exemplar, and of one of the scenes that are stored for it."""


class SceneBatch(Protocol):
    """A batch of scenes, one for each layer of a batch."""

    @property
    def gbuffer(self) -> Float[Tensor, "batch height width 6"] | None:
        """Position and normal that each pixel shows, premultiplied; None where they are as in the exemplars' scenes."""
        ...

    @property
    def light_buffer(self) -> Float[Tensor, "batch height width 9"] | None:
        """How these scenes light reference materials, without gradients; None where they are the exemplars' scenes.

        See `svbrdfgan.training.reference_pictures`. It has as many samples as `render`'s pictures, and other ones.
        """
        ...

    def render(self, layers: Layers) -> tuple[Images, Coverage]:
        """The pictures of these layers on the learnable parts, differentiable in the layers; and their coverage."""
        ...


def with_progress(indices: Iterable[int], progress: Callable[[int], None] | None) -> Iterator[int]:
    """The indices; after each is dealt with, `progress` is told of one more."""
    for index in indices:
        yield index
        if progress is not None:
            progress(1)


def chosen_scenes(indices: Sequence[int], rng: np.random.Generator, pool: int) -> list[SceneKey]:
    """One of the `pool` stored scenes for each exemplar."""
    return [(index, int(rng.integers(pool))) for index in indices]


def prepared_surface(exemplars: Exemplars, index: int, renderer: CheckedRenderer, prepared: dict[int, Any]) -> Any:
    """An exemplar's surface as its renderer prepared it; `prepared` keeps it, by subject, for the next call."""
    number = int(exemplars.subject_of[index])
    if number not in prepared:
        prepared[number] = renderer.prepare(exemplars.subjects[number].surface)
    return prepared[number]


def seen_in_gradient(
    exemplars: Exemplars,
    index: int,
    renderer: CheckedRenderer,
    prepared: Any,
    spp: int,
    pixels: Bool[Tensor, "height width"] | None = None,
) -> Float[Tensor, "rows cols"]:
    """Positive at texels that an exemplar's picture shows of the outermost learnable surface; from its gradient.

    Args:
        pixels: what counts of the picture; None stands for all of it.
    """
    scene, subject = exemplars.scenes[index], exemplars.subject(index)
    grey = Layer(torch.full((*subject.buffer.part.shape, RGBA), 0.5, device=renderer.device))
    view = exemplars.loader.view(scene)
    counted = torch.ones(view.height, view.width) if pixels is None else pixels.float()
    gradients = renderer.render_vjp(
        prepared,
        subject.materials(grey, base_colors=scene.materials),
        view,
        counted.unsqueeze(-1).repeat(1, 1, 3).to(renderer.device),
        wrt=frozenset({"base_color"}),
        spp=spp,
        seed=scene.seed,
    )
    seen = [gradients.materials[part]["base_color"].abs().sum(dim=-1).cpu() for part in subject.learnable]
    return of_outermost_parts(exemplars, index, torch.stack(seen))


def of_outermost_parts(
    exemplars: Exemplars, index: int, values: Float[Tensor, "parts rows cols"]
) -> Float[Tensor, "rows cols"]:
    """From values for each learnable part, at each texel the value of the part that is outermost there; 0 elsewhere."""
    subject = exemplars.subject(index)
    picked = torch.zeros_like(values[0])
    for slot, part in enumerate(subject.learnable):
        mine = subject.buffer.part == part
        picked[mine] = values[slot][mine]
    return picked
