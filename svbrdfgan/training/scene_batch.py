"""Batches of scenes that fakes are rendered in, and what all ways of rendering them have in common."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Protocol

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.metrics.recovered import SeenTexels
from svbrdfgan.rendering.checked_renderer import CheckedRenderer, PreparedSurface
from svbrdfgan.scene.loader import make_room
from svbrdfgan.training.config import ScenesConfig
from svbrdfgan.training.demodulation import Demodulator
from svbrdfgan.types import RGBA, Layer

Layers = Float[Tensor, "batch rows cols channels"]
Images = Float[Tensor, "batch height width 3"]
Coverage = Float[Tensor, "batch height width"]

Progress = Callable[[int], None]
"""Called with the number of scenes that are done since the last call."""

SceneKey = tuple[int, int]
"""The index of an exemplar, and of one of the scenes that are stored for it."""


class SceneBatch(Protocol):
    """A batch of scenes, one for each layer of a batch."""

    @property
    def gbuffer(self) -> Float[Tensor, "batch height width 6"] | None:
        """Position and normal that each pixel shows, premultiplied; None where they are as in the exemplars' scenes."""

    @property
    def light_buffer(self) -> Float[Tensor, "batch height width 9"] | None:
        """Pictures of reference materials in these scenes, without gradients; None where they are as in the exemplars'.

        See `svbrdfgan.training.reference_pictures`. The samples are as many as in `render`'s pictures, and others.
        """

    @property
    def clean(self) -> Float[Tensor, "batch height width 3"] | None:
        """Pictures of these scenes without the layer; None where they are as in the exemplars'. See `light_buffer`."""

    @property
    def demodulator(self) -> Demodulator | None:
        """Divides the light of these scenes out of their pictures; None if it is not known what pixels show."""

    def render(self, layers: Layers) -> tuple[Images, Coverage]:
        """The pictures of these layers on the learnable parts, differentiable in the layers; and their coverage."""


class SceneRendering(Protocol):
    """Scenes for the fakes of some exemplars, which are named by their indices."""

    def build(self, indices: Iterable[int], progress: Progress | None = None) -> None:
        """Does ahead what would else be done when `scenes` first asks for these exemplars, as far as it is kept."""

    def scenes(self, indices: Sequence[int], rng: np.random.Generator, visit: int = 0) -> SceneBatch:
        """A scene for each exemplar, chosen or drawn by `rng`.

        Args:
            visit: how often training has seen these exemplars before.
        """

    def prefetch(self, indices: Sequence[int], rng: np.random.Generator) -> None:
        """Starts to read what `scenes`, given an equal `rng`, will need for these exemplars. Returns at once."""

    def first_scenes(self, indices: Sequence[int]) -> SceneBatch:
        """The first stored scene of each exemplar, or its own scene where none is stored; with all of their buffers."""

    def seen(self, index: int) -> Float[Tensor, "rows cols"]:
        """Positive at texels that an exemplar's picture shows of the outermost learnable surface."""

    def own_scenes(self, spp: int, *, keep: bool) -> SceneRendering:
        """The exemplars' own scenes, one for each, with `spp` samples per pixel where they are stored.

        Args:
            keep: whether training looks at them at every step, so that they stay on the device, and not just once.
        """

    def seen_in(self, config: ScenesConfig) -> SeenTexels | None:
        """`seen` of otherwise perturbed scenes, one for each exemplar; None if only the exemplars' own are known."""

    def resampled(self, spp: int) -> SceneRendering | None:
        """The same scenes with `spp` samples per pixel, new at each visit; None where samples are stored."""


def with_progress(indices: Iterable[int], progress: Progress | None) -> Iterator[int]:
    """The indices; after each is dealt with, `progress` is told of one more."""
    for index in indices:
        yield index
        if progress is not None:
            progress(1)


def chosen_scenes(indices: Sequence[int], rng: np.random.Generator, pool: int) -> list[SceneKey]:
    """The keys of one of the `pool` stored scenes for each exemplar."""
    return [(index, int(rng.integers(pool))) for index in indices]


class PreparedSurfaces:
    """Surfaces of the exemplars' subjects as a renderer prepared them, each when it is first asked for.

    All of them are kept; of windows, which are as many as exemplars, those that were prepared last.

    Args:
        single: keeps only the surface that was prepared last.
    """

    def __init__(self, exemplars: Exemplars, renderer: CheckedRenderer, *, single: bool = False) -> None:
        self._exemplars, self._renderer, self._single = exemplars, renderer, single
        self._held: dict[int, PreparedSurface] = {}

    def of(self, index: int) -> PreparedSurface:
        """The prepared surface of an exemplar's subject."""
        number = int(self._exemplars.subject_of[index])
        if number not in self._held:
            if self._single:
                self._held.clear()  # first, so that memory never holds two
            elif self._exemplars.scenes[index].window is not None:
                make_room(self._held)
            self._held[number] = self._renderer.prepare(self._exemplars.subjects[number].surface)
        return self._held[number]


def seen_in_gradient(
    exemplars: Exemplars,
    index: int,
    renderer: CheckedRenderer,
    prepared: PreparedSurface,
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
    """The values, at each texel, of the learnable part that is outermost there; 0 elsewhere."""
    subject = exemplars.subject(index)
    picked = torch.zeros_like(values[0])
    for slot, part in enumerate(subject.learnable):
        mine = subject.buffer.part == part
        picked[mine] = values[slot][mine]
    return picked
