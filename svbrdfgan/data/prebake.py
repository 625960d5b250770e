"""Worker processes that embed, bake and weather meshes ahead of the renderer."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from pathlib import Path

import torch

from svbrdfgan.errors import AssetError
from svbrdfgan.scene.description import Scene, SceneWeathering
from svbrdfgan.scene.loader import SceneLoader


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
    pool = ProcessPoolExecutor(min(workers, len(groups)), get_context("spawn"), torch.set_num_threads, (1,))
    try:
        number = {pool.submit(_bake, folder, group): n for n, group in enumerate(groups)}
        for future in as_completed(number):
            future.result()
            yield number[future]
    except BrokenProcessPool as error:
        raise AssetError("a process that bakes meshes was killed, probably for memory; try fewer --workers.") from error
    finally:
        pool.shutdown(cancel_futures=True)


def _bake(folder: Path, scenes: Sequence[Scene]) -> None:
    loader = SceneLoader(folder)
    for scene in scenes:
        loader.subject(scene)
        # with a model, each worker would load it, and its own context of a GPU
        if not isinstance(scene.weathering, SceneWeathering) or scene.weathering.model is None:
            loader.layer(scene)
