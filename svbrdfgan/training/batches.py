"""Batches of one split: exemplars on the device, and the scenes that their fakes are rendered in."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.data.conditions import labels_of_scenes
from svbrdfgan.data.config import EnvironmentSource, Split
from svbrdfgan.data.exemplars import Exemplars, load_exemplars
from svbrdfgan.data.gather import gather_environments, match_files
from svbrdfgan.data.reflectance_errors import ReflectanceErrors, load_errors
from svbrdfgan.metrics.recovered import SeenTexels
from svbrdfgan.networks.inputs import Inputs
from svbrdfgan.rendering.checked_renderer import CheckedRenderer
from svbrdfgan.rendering.render_layer import RenderLayer
from svbrdfgan.training.cached_rendering import CachedRendering
from svbrdfgan.training.config import DiscriminatorConfig, TrainConfig
from svbrdfgan.training.deferred_rendering import DeferredRendering
from svbrdfgan.training.discriminator_batch import ImageBatch
from svbrdfgan.training.online_rendering import OnlineRendering
from svbrdfgan.training.perturb import Perturbation
from svbrdfgan.training.reference_pictures import require_reference_materials
from svbrdfgan.training.resolve import ResolvedRun
from svbrdfgan.training.scene_batch import Progress, SceneBatch, SceneRendering
from svbrdfgan.training.subject_inputs import WindowInputs, subject_inputs
from svbrdfgan.utils.copy_async import copy_async
from svbrdfgan.utils.devices import device_bytes
from svbrdfgan.utils.display import Display, SilentDisplay
from svbrdfgan.utils.large_tensors import half_tensor

_ON_DEVICE = 0.25
"""The share of a device's memory that pictures and their buffers take at most."""


@dataclass(frozen=True, eq=False)
class BatchSource:
    """A split, ready for training or scoring.

    Attributes:
        exemplars: the split in main memory.
        fake_scenes: renders fakes, in perturbed scenes.
        own_scenes: the exemplars' own scenes, which say what the exemplars show; `fake_scenes` itself where those are
            not perturbed and have enough samples, or are rendered online.
        buffers: the generator's input for each subject, on the device, or read when it is asked for.
        real: the exemplars, with the buffers of their own scenes that the discriminator is shown, and with the labels
            of their layers and the size of their pixels; on the device, or in main memory if they are too many.
        demodulated: whether the discriminator sees reflectance instead of radiance.
        errors: those that the exemplars' import may have made, for fakes to have, too; None if they were rendered.
    """

    exemplars: Exemplars
    fake_scenes: SceneRendering
    own_scenes: SceneRendering
    buffers: Inputs | WindowInputs
    real: ImageBatch
    demodulated: bool = False
    errors: ReflectanceErrors | None = None

    def __len__(self) -> int:
        return len(self.exemplars)

    @property
    def windowed(self) -> bool:
        """Whether the layers are those of windows."""
        return self.exemplars.windowed

    @property
    def device(self) -> torch.device:
        """Where batches are."""
        return self.buffers.device

    def pictures(self, indices: Sequence[int]) -> ImageBatch:
        """These exemplars, with all that the discriminator is shown of them."""
        return self.real.pick(indices, self.device)

    def inputs(self, indices: Sequence[int]) -> Inputs:
        """The generator's input for the subjects of these exemplars."""
        return self.buffers.pick(self.exemplars.subject_of[list(indices)])

    def labels(self, indices: Sequence[int]) -> Float[Tensor, "batch labels"] | None:
        """The labels of these exemplars' layers; None if networks are told nothing of them."""
        labels = self.real.labels
        if labels is None:
            return None
        return copy_async(labels[copy_async(torch.as_tensor(list(indices)), labels.device)], self.device)

    def seen(self, index: int) -> Float[Tensor, "rows cols"]:
        """Positive at texels that an exemplar's picture shows of the outermost learnable surface."""
        return self.own_scenes.seen(index)

    def scenes(self, indices: Sequence[int], rng: np.random.Generator, visit: int = 0) -> SceneBatch:
        """Scenes for the fakes of these exemplars, which training has seen `visit` times before."""
        return self.fake_scenes.scenes(indices, rng, visit)

    def drawn_errors(
        self, indices: Sequence[int], rng: np.random.Generator
    ) -> Float[Tensor, "batch height width 8"] | None:
        """Errors for the fakes of these exemplars; None where exemplars have none."""
        return None if self.errors is None else self.errors.drawn(indices, rng, self.device)

    def prefetch(self, indices: Sequence[int], rng: np.random.Generator) -> None:
        """Starts to read what `scenes`, given an equal `rng`, and demodulation will need for these exemplars."""
        self.fake_scenes.prefetch(indices, rng)
        if self.demodulated and self.own_scenes is not self.fake_scenes:
            self.own_scenes.prefetch(indices, np.random.default_rng(0))


def make_batch_source(
    run: ResolvedRun, split: Split, renderer: CheckedRenderer, device: torch.device, display: Display | None = None
) -> BatchSource:
    """Loads a split and traces its scenes, a phase that is shown. Only the training split's scenes are perturbed.

    Raises:
        AssetError: the data set is not finished, or a file of it is damaged.
        ConfigError: `rendering` is `stored`, and the renderer does not store what that needs; or it cannot render
            the reference materials of a light buffer.
    """
    run = run if split == "train" else run.unperturbed()
    discriminator = run.config.discriminator
    if discriminator.light_buffer:
        require_reference_materials(renderer)
    exemplars = load_exemplars(run.dataset, split, run.config.generator)
    fake_scenes = make_scenes(run, exemplars, split, renderer, device)
    own_scenes = _own_scenes(run.config, fake_scenes, exemplar_spp(run.config, exemplars))
    order = _by_subject(exemplars)
    demodulated = discriminator.compares == "reflectance"
    apart = own_scenes is not fake_scenes and (demodulated or discriminator.shows_buffers)
    traced, shown = [fake_scenes, own_scenes] if apart else [fake_scenes], display or SilentDisplay()
    shown.begin(f"light transport of the {split} scenes", len(traced) * len(order))
    for scenes in traced:
        scenes.build(order, shown.advance)
    buffers = own_buffers(discriminator, own_scenes, range(len(exemplars)), exemplars.loader.cache)
    sizes = pixel_sizes(exemplars) if discriminator.pixel_size else None
    labels = labels_of_scenes(run.conditions, exemplars.scenes)
    real = ImageBatch(exemplars.images, exemplars.coverage, *buffers, labels, sizes)
    if real.nbytes <= _ON_DEVICE * device_bytes(device):
        real = real.to(device)
    errors = None
    if split == "train" and demodulated and run.config.scenes.same_camera and run.config.scenes.import_errors:
        errors = load_errors(run.dataset.folder, split, len(exemplars))
    inputs = subject_inputs(exemplars, device)
    return BatchSource(exemplars, fake_scenes, own_scenes, inputs, real, demodulated, errors)


def pixel_sizes(exemplars: Exemplars) -> Float[Tensor, "exemplars 1"]:
    """How large a pixel is on the surface that each exemplar's camera looks at, by a logarithm.

    The result is 0 for a pixel of a 512th of the vehicle's length, 1 for one that is sixteen times as large, and -1 for
    one of a sixteenth of that.
    """
    found, boxes = [], dict[str, Tensor]()
    for index, scene in enumerate(exemplars.scenes):
        if (mesh := scene.mesh.path) not in boxes:  # the whole mesh's, of windows, too
            boxes[mesh] = exemplars.subject(index).buffer.bounds.clone()
        camera, (low, high) = scene.camera.camera(), boxes[mesh]
        seen = math.dist(camera.origin, camera.target) * 2.0 * math.tan(camera.vertical_fov / 2.0)
        found.append(math.log(512.0 * seen / (scene.height * float((high - low).max())), 16.0))
    return torch.tensor(found).unsqueeze(1)


def load_seen_texels(
    run: ResolvedRun, split: Split, renderer: CheckedRenderer, progress: Progress | None = None
) -> tuple[Exemplars, SeenTexels]:
    """A split, and a function that says which texels a picture of it shows: all that scores need.

    A scene is traced when the function is first called for it.

    Raises:
        AssetError: the data set is not finished, or a file of it is damaged.
        ConfigError: `rendering` is `stored`, and the renderer does not store what that needs.
    """
    exemplars = load_exemplars(run.dataset, split, run.config.generator)
    own = run.unperturbed().with_config(spp=exemplar_spp(run.config, exemplars))
    # nothing is kept, since each scene is looked at once
    scenes = make_scenes(own, exemplars, split, renderer, torch.device("cpu"), cache_bytes=0)

    def seen(index: int) -> Float[Tensor, "rows cols"]:
        if progress is not None:
            progress(1)
        return scenes.seen(index)

    return exemplars, seen


Buffers = tuple[
    Float[Tensor, "exemplars height width 6"] | None,
    Float[Tensor, "exemplars height width 9"] | None,
    Float[Tensor, "exemplars height width 3"] | None,
]
"""G-buffers, light buffers and clean pictures; None if they are not shown."""


def own_buffers(
    config: DiscriminatorConfig, own_scenes: SceneRendering, indices: Sequence[int], folder: Path
) -> Buffers:
    """What the discriminator is shown besides the pictures, of these exemplars' own scenes, in half precision.

    Args:
        folder: for the files of those that are large.
    """
    made: dict[str, Tensor] = {}
    for place, index in enumerate(indices if config.shows_buffers else ()):
        batch = own_scenes.first_scenes([index])  # one for all buffers: making it may trace
        shown = {
            "gbuffer": batch.gbuffer if config.gbuffer else None,
            "light": batch.light_buffer if config.light_buffer else None,
            "clean": batch.clean if config.clean_picture else None,
        }
        for name, buffer in shown.items():
            if buffer is None:
                continue
            if name not in made:
                made[name] = half_tensor((len(indices), *buffer.shape[1:]), folder)
            made[name][place] = buffer[0]
    return made.get("gbuffer"), made.get("light"), made.get("clean")


def make_scenes(
    run: ResolvedRun,
    exemplars: Exemplars,
    split: Split,
    renderer: CheckedRenderer,
    device: torch.device,
    cache_bytes: int | None = None,
) -> SceneRendering:
    """Renders fakes in the scenes of these exemplars, perturbed as the configuration says.

    Args:
        cache_bytes: memory for what is stored of scenes; None takes a share of the device's, and 0 keeps only the last.
    """
    config, dataset = run.config, run.dataset
    environments = None
    if isinstance(config.scenes.environment, EnvironmentSource):
        files = match_files(config.scenes.environment.files, run.base)
        rows = dataset.config.environment_rows
        environments = gather_environments(config.scenes.environment, files, rows, dataset.folder)
    perturbation = Perturbation(config.scenes, dataset.index.sampler(split), environments)
    if config.rendering == "online":
        return OnlineRendering(exemplars, perturbation, RenderLayer(renderer, config.spp, config.spp_grad))
    pool, spp, seed = config.scenes.pool, config.spp, config.seed
    if run.deferred:
        return DeferredRendering(
            exemplars,
            perturbation,
            renderer,
            spp,
            config.hits,
            pool,
            device,
            seed,
            shows_gbuffer=config.discriminator.gbuffer,
            shows_light=config.discriminator.light_buffer,
            shows_clean=config.discriminator.clean_picture,
            cache_bytes=cache_bytes,
            clean_spp=config.clean_spp,
        )
    options = config.renderer.options
    return CachedRendering(exemplars, perturbation, renderer, spp, pool, device, seed, options, cache_bytes)


def exemplar_spp(config: TrainConfig, exemplars: Exemplars) -> int:
    """Samples per pixel of the exemplars' own scenes: at least the exemplars', where their light is divided out."""
    demodulated = config.discriminator.compares == "reflectance"
    return max([config.spp] + [scene.spp for scene in exemplars.scenes if demodulated])


def _own_scenes(config: TrainConfig, fake_scenes: SceneRendering, spp: int) -> SceneRendering:
    """The exemplars' own scenes; not kept in memory where training looks at each of them once."""
    if config.scenes.matched and config.scenes.pool and spp == config.spp:
        return fake_scenes
    return fake_scenes.own_scenes(spp, keep=config.discriminator.compares == "reflectance")


def _by_subject(exemplars: Exemplars) -> list[int]:
    """Exemplar indices grouped by subject, the subjects in unseeded random order.

    Several processes that trace the same scenes start with different subjects, and find the other processes' files.
    """
    place = np.random.default_rng().permutation(len(exemplars.subjects))
    return np.argsort(place[exemplars.subject_of.numpy()], kind="stable").tolist()
