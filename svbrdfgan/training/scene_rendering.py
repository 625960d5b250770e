"""Ways to render fakes: what cached, deferred and online rendering have in common."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Protocol

import numpy as np
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.metrics.recovered import SeenTexels
from svbrdfgan.training.config import ScenesConfig
from svbrdfgan.training.scene_batch import SceneBatch

Progress = Callable[[int], None]
"""Called with the number of scenes that are done since the last call."""


class SceneRendering(Protocol):
    """Scenes for the fakes of some exemplars, which are named by their indices."""

    def build(self, indices: Iterable[int], progress: Progress | None = None) -> None:
        """Does ahead what would else be done when `scenes` first asks for these exemplars, as far as it is kept."""
        ...

    def scenes(self, indices: Sequence[int], rng: np.random.Generator, visit: int = 0) -> SceneBatch:
        """A scene for each exemplar, chosen or drawn by `rng`.

        Args:
            visit: how often training has seen these exemplars before.
        """
        ...

    def prefetch(self, indices: Sequence[int], rng: np.random.Generator) -> None:
        """Starts to read what `scenes`, given an equal `rng`, will need for these exemplars. Returns at once."""
        ...

    def first_scenes(self, indices: Sequence[int]) -> SceneBatch:
        """The first stored scene of each exemplar, or its own scene where none is stored; with all of their buffers."""
        ...

    def seen(self, index: int) -> Float[Tensor, "rows cols"]:
        """Positive at texels that an exemplar's picture shows of the outermost learnable surface."""
        ...

    def own_scenes(self, spp: int, *, keep: bool) -> SceneRendering:
        """The exemplars' own scenes, one for each, with so many samples per pixel where they are stored.

        Args:
            keep: whether training looks at them at every step, so that they stay on the device, and not just once.
        """
        ...

    def seen_in(self, config: ScenesConfig) -> SeenTexels | None:
        """`seen` of otherwise perturbed scenes, one for each exemplar; None if only the exemplars' own are known."""
        ...

    def resampled(self, spp: int) -> SceneRendering | None:
        """The same scenes with so many samples, new at each visit; None where pictures are of stored samples."""
        ...
