"""What training is fed: exemplars on the device, and the stages in which fakes are shown."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.data.config import EnvironmentSource, Split
from svbrdfgan.data.exemplars import Exemplars, load_exemplars
from svbrdfgan.data.index import DatasetPlan, gather_environments
from svbrdfgan.errors import ConfigError
from svbrdfgan.metrics.recovered import SeenTexels
from svbrdfgan.protocols import Renderer
from svbrdfgan.rendering.render_layer import RenderLayer
from svbrdfgan.rendering.transport.cache import TransportCache
from svbrdfgan.scene.loader import require_maps
from svbrdfgan.training.cached_rendering import Stage, Transports
from svbrdfgan.training.config import ScenesConfig, TrainConfig, settled
from svbrdfgan.training.demodulation import Sight
from svbrdfgan.training.online_rendering import FreshRenders
from svbrdfgan.training.perturb import Perturbation
from svbrdfgan.utils.copy_async import copy_async


@dataclass(frozen=True, eq=False)
class Feed:
    """One split, ready for training or scoring.

    Attributes:
        stages: where fakes are rendered.
        own: the exemplars' own scenes, which tell what their pictures show; the stages themselves where they are not
            perturbed and have samples enough, or are rendered anew. Traced as they are asked for, unless the
            discriminator is shown what they tell.
        gbuffers: position and normal as seen in each exemplar; None where the discriminator does not look at them.
        demodulated: whether the discriminator sees reflectance, rather than radiance.
    """

    exemplars: Exemplars
    stages: Transports | FreshRenders
    own: Transports | FreshRenders
    buffers: Float[Tensor, "subjects 6 rows cols"]
    images: Float[Tensor, "exemplars height width 3"]
    coverage: Float[Tensor, "exemplars height width"]
    gbuffers: Float[Tensor, "exemplars height width 6"] | None
    demodulated: bool = False

    def __len__(self) -> int:
        return len(self.exemplars)

    def geometry(self, indices: Sequence[int]) -> Float[Tensor, "batch 6 rows cols"]:
        """What the generator sees of these exemplars' subjects."""
        return self.buffers[copy_async(self.exemplars.subject_of[list(indices)], self.buffers.device)]

    def real(self, indices: Sequence[int]) -> tuple[Tensor, Tensor, Tensor | None]:
        """Image, coverage and G-buffer of these exemplars."""
        picked = copy_async(torch.tensor(indices), self.images.device)
        gbuffer = None if self.gbuffers is None else self.gbuffers[picked]
        return self.images[picked], self.coverage[picked], gbuffer

    def seen(self, index: int) -> Float[Tensor, "rows cols"]:
        """Where an exemplar's picture shows the outermost learnable surface, positive."""
        return self.own.seen(index)

    def sight(self, indices: Sequence[int]) -> Sight:
        """What these exemplars show of their textures."""
        if not isinstance(self.own, Transports):
            raise TypeError(f"{type(self.own).__name__} do not know what pictures show")
        return Sight.of(self.own.batch(indices))

    def stage(self, indices: Sequence[int], rng: np.random.Generator) -> Stage:
        """Scenes for as many fakes."""
        return self.stages.stage(indices, rng)

    def expect(self, indices: Sequence[int], rng: np.random.Generator) -> None:
        """Begins to read what `stage`, given a generator in the same state, and `sight` will want of these."""
        self.stages.expect(indices, rng)
        if self.demodulated and self.own is not self.stages:
            self.own.expect(indices, np.random.default_rng(0))


def make_feed(
    config: TrainConfig,
    folder: Path,
    split: Split,
    renderer: Renderer[Any],
    device: torch.device,
    *,
    base: Path = Path(),
    progress: Callable[[int], None] | None = None,
) -> Feed:
    """Loads a split and makes its stages. Only the training split's scenes are perturbed.

    Raises:
        AssetError: the data set is not there, not finished, or damaged.
        ConfigError: the renderer cannot do what the configuration asks.
    """
    plan = DatasetPlan.load(folder)
    require_possible(config, plan, renderer)
    config = settled(config, plan.config.spp)
    exemplars = load_exemplars(folder, split)
    config = config if split == "train" else config.model_copy(update={"scenes": ScenesConfig()})
    stages = make_stages(config, exemplars, split, renderer, device, base)
    own, order = _own(config, stages), _any_order(exemplars)
    demodulated = config.discriminator.sees == "reflectance"
    stages.build(order, progress)
    if own is not stages and (demodulated or config.discriminator.guide):
        own.build(order, progress)
    images = exemplars.images.to(device)
    return Feed(
        exemplars=exemplars,
        stages=stages,
        own=own,
        buffers=buffers_of(exemplars, device),
        images=images,
        coverage=exemplars.coverage.to(device),
        gbuffers=_gbuffers(config, own, device),
        demodulated=demodulated,
    )


def make_seen(
    config: TrainConfig,
    folder: Path,
    split: Split,
    renderer: Renderer[Any],
    progress: Callable[[int], None] | None = None,
) -> tuple[Exemplars, SeenTexels]:
    """A split, and what its pictures show: all that targets need. A scene is traced when it is asked for.

    Raises:
        AssetError: the data set is not there, not finished, or damaged.
        ConfigError: the renderer cannot do what the configuration asks.
    """
    exemplars = load_exemplars(folder, split)
    told = settled(config, DatasetPlan.load(folder).config.spp)
    told = told.model_copy(update={"scenes": ScenesConfig(), "spp": own_spp(told, exemplars)})
    own = make_stages(told, exemplars, split, renderer, torch.device("cpu"), Path())
    if isinstance(own, Transports):
        own = replace(own, _held=TransportCache(0))

    def seen(index: int) -> Float[Tensor, "rows cols"]:
        if progress is not None:
            progress(1)
        return own.seen(index)

    return exemplars, seen


def buffers_of(exemplars: Exemplars, device: torch.device) -> Float[Tensor, "subjects 6 rows cols"]:
    """What the generator sees of each subject, its channels last."""
    return torch.stack([s.geometry for s in exemplars.subjects]).to(device, memory_format=torch.channels_last)


def make_stages(
    config: TrainConfig, exemplars: Exemplars, split: Split, renderer: Renderer[Any], device: torch.device, base: Path
) -> Transports | FreshRenders:
    """Where fakes are rendered: in the scenes of these exemplars, perturbed as the configuration says."""
    scenes, folder = config.scenes, exemplars.studio.folder
    plan = DatasetPlan.load(folder)
    lights = None
    if isinstance(scenes.environment, EnvironmentSource):
        lights = gather_environments(scenes.environment, plan.config.environment_rows, folder, base)
    perturbation = Perturbation(scenes, plan.sampler(split), lights)
    if config.rendering == "fresh":
        return FreshRenders(exemplars, perturbation, RenderLayer(renderer, config.spp, config.spp_grad))
    return Transports(
        exemplars, perturbation, renderer, config.spp, scenes.pool, device, config.seed, config.renderer.options
    )


def require_possible(config: TrainConfig, plan: DatasetPlan, renderer: Renderer[Any]) -> None:
    """Refuses a renderer that the data set's maps cannot be learned through as configured.

    Raises:
        ConfigError: what it cannot do.
    """
    maps = plan.config.maps
    if maps and config.rendering == "transport":
        raise ConfigError(
            f"rendering: transport is for base_color alone, and the data set's layers paint {', '.join(maps)} too: "
            "set rendering: fresh, and a renderer whose capabilities name these maps."
        )
    require_maps(renderer, maps, differentiable=True)


def _own(config: TrainConfig, stages: Transports | FreshRenders) -> Transports | FreshRenders:
    """Stages of the exemplars' own scenes; not held in memory where training only looks at them once."""
    if isinstance(stages, FreshRenders):
        return stages
    spp = own_spp(config, stages.exemplars)
    if config.scenes.matched and config.scenes.pool and spp == config.spp:
        return stages
    matched = Perturbation(ScenesConfig(), stages.perturbation.sampler)
    own = Transports(stages.exemplars, matched, stages.renderer, spp, 1, stages.device, config.seed, stages.options)
    if config.discriminator.sees == "reflectance":
        return own
    return replace(own, device=torch.device("cpu"), _held=TransportCache(0))


def own_spp(config: TrainConfig, exemplars: Exemplars) -> int:
    """Samples per pixel of the exemplars' own scenes. What divides their light out has no fewer than they."""
    demodulated = config.discriminator.sees == "reflectance"
    return max([config.spp] + [scene.spp for scene in exemplars.scenes if demodulated])


def _any_order(exemplars: Exemplars) -> list[int]:
    """All of them, subject by subject, by true chance.

    Processes that want the same scenes at the same time so begin with different ones, and find the others' stored.
    """
    place = np.random.default_rng().permutation(len(exemplars.subjects))
    return np.argsort(place[exemplars.subject_of.numpy()], kind="stable").tolist()


def _gbuffers(
    config: TrainConfig, own: Transports | FreshRenders, device: torch.device
) -> Float[Tensor, "exemplars height width 6"] | None:
    """What each exemplar shows."""
    if not config.discriminator.guide or not isinstance(own, Transports):
        return None
    return torch.stack([own.gbuffer(index) for index in range(len(own.exemplars))]).half().to(device)
