"""Worker processes that embed, bake and weather meshes ahead of the renderer."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import as_completed
from pathlib import Path

from svbrdfgan.scene.description import Scene, SceneWeathering
from svbrdfgan.scene.loader import SceneLoader
from svbrdfgan.utils.processes import worker_pool


def prebake(folder: Path, groups: Sequence[Sequence[Scene]], workers: int) -> Iterator[int]:
    """Yields the index of each group as soon as the subjects and layers of its scenes are in the folder's cache.

    With one worker it prebakes nothing, and yields the indices in order.

    Args:
        groups: scenes of one mesh each.
        workers: processes. They are spawned, so they import the caller's main module.

    Raises:
        AssetError: a mesh cannot be read, embedded or baked; or a process was killed.
    """
    if workers == 1 or len(groups) < 2:
        yield from range(len(groups))
        return
    with worker_pool(min(workers, len(groups)), "bakes meshes", "--workers") as pool:
        number = {pool.submit(_bake, folder, group): n for n, group in enumerate(groups)}
        for future in as_completed(number):
            future.result()
            yield number[future]


def _bake(folder: Path, scenes: Sequence[Scene]) -> None:
    loader = SceneLoader(folder)
    for scene in scenes:
        loader.subject(scene)
        # with a model, each worker would load it, and its own context of a GPU
        if not isinstance(scene.weathering, SceneWeathering) or scene.weathering.model is None:
            loader.layer(scene)
