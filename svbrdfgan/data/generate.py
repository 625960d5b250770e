"""Renders the exemplars of a data set, by one process or several. Interrupted at any moment, it can be resumed."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import torch
from lightning_fabric import Fabric

from svbrdfgan.config.choices import PluginChoice
from svbrdfgan.config.distributions import values_of
from svbrdfgan.data.config import DatasetConfig, Split
from svbrdfgan.data.exemplar_files import SplitFiles, exemplar_paths, save_exemplar
from svbrdfgan.data.index import Dataset, DatasetIndex
from svbrdfgan.data.labels import make_labels, save_labels
from svbrdfgan.data.make_index import make_index
from svbrdfgan.data.memory import require_dataset
from svbrdfgan.data.prebake import prebake
from svbrdfgan.data.shards import Shard, gathering, mark_shard, remove_marks
from svbrdfgan.data.trained_model import with_model
from svbrdfgan.errors import ConfigError
from svbrdfgan.io.claims import claimed, claimed_folder
from svbrdfgan.plugins.registry import load_embedding
from svbrdfgan.plugins.select import resolve_renderer
from svbrdfgan.rendering.checked_renderer import CheckedRenderer, PreparedSurface
from svbrdfgan.scene.description import Scene
from svbrdfgan.scene.loader import SceneLoader
from svbrdfgan.types import Rendering
from svbrdfgan.utils.display import Display, SilentDisplay
from svbrdfgan.weathering.layer import recipe_from_options

log = logging.getLogger(__name__)


def generate(
    config: DatasetConfig,
    folder: Path,
    *,
    base: Path,
    devices: int = 1,
    workers: int = 1,
    shard: Shard | None = None,
    display: Display | None = None,
) -> DatasetIndex:
    """Writes the data set's exemplars that are not there yet.

    Args:
        base: the folder that file patterns of the configuration are relative to.
        devices: processes, one for each GPU where there are any. They share the work by mesh.
        workers: processes that gather meshes, and then embed and bake them ahead of the renderer, divided among the
            devices. More than one are spawned, so a script that asks for them needs its `if __name__ == "__main__"`.
        shard: the share to write; None writes the whole. Several may write into one folder at once, or each into its
            own. `merge_shards` makes the whole of them.
        display: shows progress; with several devices, the progress of the first process's share.

    Raises:
        ConfigError: the folder holds another data set, or shards of another number; a pattern matches nothing; the
            renderer, the embedding, the recipe or the model cannot do what is asked; or it needs more memory than may
            be taken.
        AssetError: an asset or the model cannot be read, the disk cannot be written, or another process works there.
        PluginError: the renderer or the embedding is unknown, or does not work here.
    """
    fabric = Fabric(accelerator="auto", devices=devices, strategy="ddp_spawn" if devices > 1 else "auto")
    config = with_model(config, folder, base)
    renderer, choice = resolve_plugins(config, fabric.device)
    require_dataset(config, 0, devices, workers)
    with _opened(config, folder, base, workers, shard) as dataset:
        job = _Job(dataset, choice, _missing_by_mesh(dataset, shard), max(1, workers // devices))
        if devices > 1:
            fabric.launch(partial(_render_on_device, job=job))
        else:
            _render_share(fabric, job, renderer, display or SilentDisplay())
        return dataset.index


def missing(index: DatasetIndex, folder: Path, shard: Shard | None = None) -> Iterator[tuple[Split, int]]:
    """Split and number of each exemplar, of the shard or of all, that is not rendered yet; in the index's order."""
    exemplars = index.exemplars()
    there = {split: SplitFiles(folder, split).numbers for split in index.config.splits}
    for split, number in exemplars if shard is None else shard.of(exemplars):
        if number not in there[split]:
            yield split, number


def render_scene(
    loader: SceneLoader, renderer: CheckedRenderer, scene: Scene, prepared: PreparedSurface | None = None
) -> Rendering:
    """The picture of a scene with its weathering."""
    subject = loader.subject(scene)
    surface = renderer.prepare(subject.surface) if prepared is None else prepared
    materials = subject.materials(loader.layer(scene), scene.maps, base_colors=scene.materials)
    return renderer.render(surface, materials, loader.view(scene), spp=scene.spp, seed=scene.seed)


def resolve_plugins(config: DatasetConfig, device: torch.device | None = None) -> tuple[CheckedRenderer, PluginChoice]:
    """The renderer of a data set, and the choice that its scenes record; checks its embedding and its recipe, too.

    It is called before anything is written, so that a mistake leaves nothing to delete.

    Raises:
        ConfigError: the renderer, the embedding or a recipe cannot do what is asked.
        PluginError: the renderer or the embedding is unknown, or does not work here.
    """
    load_embedding(config.embedding.name, config.embedding.options)
    if config.weathering is None:
        raise ConfigError("weathering is null, as in a data set of imported pictures: name a recipe.")
    for recipe in values_of(config.weathering.recipe) if config.weathering.model is None else ():
        recipe_from_options(recipe, config.weathering.options, config.maps)
    return resolve_renderer(config.renderer, device, config.maps)


@dataclass(frozen=True, eq=False)
class _Job:
    """The work that all processes of `generate` share.

    Attributes:
        missing: exemplars to be rendered, by mesh; found once, so that all processes share out the same list.
        workers: processes that bake meshes, for each device.
    """

    dataset: Dataset
    renderer: PluginChoice
    missing: list[list[tuple[Split, int]]]
    workers: int


@contextmanager
def _opened(config: DatasetConfig, folder: Path, base: Path, workers: int, shard: Shard | None) -> Iterator[Dataset]:
    """The data set. For the time of the block no other process can claim the folder, or of a shared one the shard."""
    with claimed_folder(folder, shared=shard is not None):
        if shard is None:
            yield Dataset(folder, make_index(config, folder, base, workers))
            remove_marks(folder)
            return
        with gathering(folder):
            index = make_index(config, folder, base, workers)
            mark = mark_shard(folder, shard)
        with claimed(mark, f"the shard {shard} of {folder} is being made by another process"):
            yield Dataset(folder, index)


def _missing_by_mesh(dataset: Dataset, shard: Shard | None) -> list[list[tuple[Split, int]]]:
    by_mesh: dict[str, list[tuple[Split, int]]] = {}
    samplers = {split: dataset.index.sampler(split) for split in dataset.config.splits}
    for split, number in missing(dataset.index, dataset.folder, shard):
        by_mesh.setdefault(samplers[split].mesh(number).name, []).append((split, number))
    return list(by_mesh.values())


def _render_on_device(fabric: Fabric, job: _Job) -> None:
    """A spawned process opens the renderer on its own device."""
    renderer, _ = resolve_renderer(job.renderer, fabric.device, job.dataset.config.maps)
    _render_share(fabric, job, renderer, SilentDisplay())


def _render_share(fabric: Fabric, job: _Job, renderer: CheckedRenderer, display: Display) -> None:
    folder, config = job.dataset.folder, job.dataset.config
    loader = SceneLoader(folder)
    display.begin("exemplars", sum(map(len, job.missing)))
    mine = job.missing[fabric.global_rank :: fabric.world_size]
    samplers = {split: job.dataset.index.sampler(split) for split in config.splits}
    made_by = {"renderer": job.renderer}
    scenes = [[samplers[split].scene(n).model_copy(update=made_by) for split, n in group] for group in mine]
    for number in prebake(folder, scenes, job.workers):
        whole, prepared = None, None
        for (split, index), scene in zip(mine[number], scenes[number], strict=True):
            picture, record = exemplar_paths(folder, split, index)
            if (surface := loader.subject(scene).surface) is not whole:  # each window has one of its own
                whole, prepared = surface, renderer.prepare(surface)
            save_exemplar(picture, render_scene(loader, renderer, scene, prepared))
            if config.labels:
                save_labels(picture, make_labels(loader, scene, config.labels, job.dataset.index.parts))
            scene.save(record)
            display.advance()
        loader.forget()
    fabric.barrier()
