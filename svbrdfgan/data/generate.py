"""Makes the exemplars of a data set, by one process or several; stopped at any moment, it goes on where it was."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

from lightning_fabric import Fabric

from svbrdfgan.data.config import DatasetConfig, Split
from svbrdfgan.data.index import DatasetPlan, make_plan
from svbrdfgan.data.prebake import baked
from svbrdfgan.errors import ConfigError
from svbrdfgan.io.exr import save_exr
from svbrdfgan.plugins import load_embedding
from svbrdfgan.protocols import Renderer
from svbrdfgan.scene.description import Scene
from svbrdfgan.scene.loader import Studio, resolve_renderer
from svbrdfgan.types import Rendering
from svbrdfgan.utils.display import Display, Silent
from svbrdfgan.weathering import recipe_from_options

BRIGHTEST = 60000.0
"""Radiance beyond it is clamped where pictures are stored, as half-precision floats."""

log = logging.getLogger(__name__)


def generate(
    config: DatasetConfig,
    folder: Path,
    *,
    base: Path,
    devices: int = 1,
    workers: int = 1,
    display: Display | None = None,
) -> DatasetPlan:
    """Writes the data set's exemplars that are not there yet.

    Args:
        base: the folder that file patterns of the configuration are relative to.
        devices: processes, one for each GPU where there are any. They share the work by mesh.
        workers: processes, shared out among the devices, that embed and bake meshes ahead of the renderer. More than
            one are spawned: a script that asks for them needs its `if __name__ == "__main__"`.
        display: shows progress; with several devices, in the first process, of its share.

    Raises:
        ConfigError: the folder holds another data set, or a pattern matches nothing.
        AssetError: an asset cannot be read, or the disk cannot be written.
    """
    require_plugins(config)
    plan = make_plan(config, folder, base)
    fabric = Fabric(accelerator="auto", devices=devices, strategy="ddp_spawn" if devices > 1 else "auto")
    work = partial(_work, plan=plan, folder=folder, by_mesh=_by_mesh(plan, folder), workers=max(1, workers // devices))
    if devices > 1:
        fabric.launch(partial(work, display=Silent()))
    else:
        work(fabric, display=display or Silent())
    return plan


def exemplar_paths(folder: Path, split: Split, index: int) -> tuple[Path, Path]:
    """The picture of an exemplar, and its scene. The scene is written last: where it is, the picture is whole."""
    stem = folder / split / f"{index:06d}"
    return stem.with_suffix(".exr"), stem.with_suffix(".json")


def missing(plan: DatasetPlan, folder: Path) -> Iterator[tuple[Split, int]]:
    """Exemplars that are still to be made, those of a mesh in a row."""
    for split in plan.config.splits:
        for index in range(len(plan.sampler(split))):
            if not exemplar_paths(folder, split, index)[1].is_file():
                yield split, index


def render_scene(studio: Studio, renderer: Renderer[Any], scene: Scene, prepared: Any | None = None) -> Rendering:
    """The picture of a scene, its weathering included."""
    subject = studio.subject(scene)
    surface = renderer.prepare(subject.surface) if prepared is None else prepared
    materials = subject.materials(scene.materials, studio.layer(scene), scene.maps)
    return renderer.render(surface, materials, studio.view(scene), spp=scene.spp, seed=scene.seed)


def save_exemplar(path: Path, rendering: Rendering) -> None:
    """Writes premultiplied linear radiance and coverage as a half-float RGBA picture."""
    red, green, blue = rendering.image.clamp(max=BRIGHTEST).unbind(-1)
    save_exr(path, {"R": red, "G": green, "B": blue, "A": rendering.coverage}, half=True)


def require_plugins(config: DatasetConfig) -> None:
    """Refuses what no exemplar could be made with, before anything is written that would have to be deleted.

    Raises:
        ConfigError: the renderer, the embedding or the recipe cannot do what is asked.
        PluginError: one of them is unknown, or does not work here.
    """
    if config.renderer.name != "auto" or config.maps:
        resolve_renderer(config.renderer, maps=config.maps)
    load_embedding(config.embedding.name, config.embedding.options)
    if config.weathering is None:
        raise ConfigError("weathering is null, as in a data set of imported pictures: name a recipe.")
    recipe_from_options(config.weathering.recipe, config.weathering.options, config.maps)


def _by_mesh(plan: DatasetPlan, folder: Path) -> list[list[tuple[Split, int]]]:
    """What is missing, found once, so that all processes share out the same list."""
    by_mesh: dict[str, list[tuple[Split, int]]] = {}
    samplers = {split: plan.sampler(split) for split in plan.config.splits}
    for split, index in missing(plan, folder):
        by_mesh.setdefault(samplers[split].mesh(index).name, []).append((split, index))
    return list(by_mesh.values())


def _work(
    fabric: Fabric,
    plan: DatasetPlan,
    folder: Path,
    by_mesh: list[list[tuple[Split, int]]],
    workers: int,
    display: Display,
) -> None:
    renderer, chosen = resolve_renderer(plan.config.renderer, fabric.device, plan.config.maps)
    studio = Studio(folder)
    display.begin("exemplars", sum(map(len, by_mesh)))
    mine = by_mesh[fabric.global_rank :: fabric.world_size]
    samplers = {split: plan.sampler(split) for split in plan.config.splits}
    made_by = {"renderer": chosen}
    scenes = [[samplers[split].scene(index).model_copy(update=made_by) for split, index in todo] for todo in mine]
    for number in baked(folder, scenes, workers):
        prepared = renderer.prepare(studio.subject(scenes[number][0]).surface)
        for (split, index), scene in zip(mine[number], scenes[number], strict=True):
            picture, record = exemplar_paths(folder, split, index)
            save_exemplar(picture, render_scene(studio, renderer, scene, prepared))
            scene.save(record)
            display.advance()
        studio.forget()
    fabric.barrier()
