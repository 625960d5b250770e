"""Previews a data set, and estimates its time, disk and memory, from a few exemplars in a temporary folder."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.data.config import DatasetConfig
from svbrdfgan.data.exemplar_files import save_exemplar
from svbrdfgan.data.generate import render_scene, resolve_plugins
from svbrdfgan.data.labels import make_labels, save_labels
from svbrdfgan.data.make_index import make_index
from svbrdfgan.data.trained_model import with_model
from svbrdfgan.plugins.select import resolve_renderer
from svbrdfgan.rendering.compositing import over
from svbrdfgan.scene.loader import SceneLoader
from svbrdfgan.utils.leftovers import scratch_folder

_FEW = 4
"""Exemplars that are timed, after one that is not: the first one also compiles."""
_PATIENCE = 20.0
"""Seconds after which no further exemplar is begun."""
_TRANSPORT_BYTES = 55
"""Bytes of stored light transport per pixel, in half precision. Measured on vehicles: 53 over 504 views at 64x64
and 32 samples, 55 over 2,028 views at 256x256."""


@dataclass(frozen=True)
class Needs:
    """The needs of a data set: seconds of one process, bytes of disk and of memory."""

    exemplars: int
    meshes: int
    seconds: float
    disk: float
    transport: float
    memory: float


def estimate(config: DatasetConfig, base: Path) -> Needs:
    """Bakes one mesh, renders a few exemplars of it, and multiplies each cost by the number in the data set."""
    config = with_model(config, None, base)
    renderer, _ = resolve_plugins(config)
    with scratch_folder() as folder:
        index = make_index(config, folder, base)
        samplers = [index.sampler(split) for split in config.splits]
        exemplars, meshes = sum(map(len, samplers)), sum(len(sampler.meshes) for sampler in samplers)
        assets = _bytes_in(folder)
        sampler = index.sampler("train")
        scenes = [sampler.draw(sampler.mesh(0), np.random.default_rng(number)) for number in range(_FEW + 1)]
        loader = SceneLoader(folder)
        began = time.monotonic()
        first = render_scene(loader, renderer, scenes.pop(0))  # includes compilation, which happens once
        baked, layer = time.monotonic() - began, _bytes_in(folder / "cache" / "layers")
        began, made, written = time.monotonic(), 0, folder / "train"
        while made < len(scenes) and time.monotonic() - began < _PATIENCE:
            picture_file = written / f"{made}.exr"
            save_exemplar(picture_file, render_scene(loader, renderer, scenes[made]))
            if config.labels:
                save_labels(picture_file, make_labels(loader, scenes[made], config.labels, index.parts))
            made += 1
        each = (time.monotonic() - began) / made
        picture = _bytes_in(written) / made
        subject = _bytes_in(folder / "cache" / "subjects")
        layers = exemplars if _bytes_in(folder / "cache" / "layers") > layer else meshes
    pixels, texels = first.coverage.numel(), config.texture**2
    # Light of whole materials is stored in memory alone, and how much of it, the training's `hits` say.
    transport = 0 if config.maps else exemplars * pixels * _TRANSPORT_BYTES
    return Needs(
        exemplars=exemplars,
        meshes=meshes,
        seconds=meshes * baked + exemplars * each,
        disk=assets + exemplars * (picture + 2048) + meshes * subject + layers * layer,
        transport=transport,
        memory=transport + exemplars * pixels * 20 + meshes * texels * 100 + layers * layer,
    )


def _bytes_in(folder: Path, pattern: str = "**/*") -> int:
    return sum(file.stat().st_size for file in folder.glob(pattern) if file.is_file())


def preview(config: DatasetConfig, base: Path) -> Float[Tensor, "height width 3"]:
    """The first exemplar next to its unweathered twin, linear, before grey."""
    config = with_model(config, None, base)
    renderer, _ = resolve_renderer(config.renderer, maps=config.maps)
    with scratch_folder() as folder:
        scene = make_index(config, folder, base).sampler("train").scene(0)
        loader = SceneLoader(folder, keep=False)
        pair = [render_scene(loader, renderer, s) for s in (scene, scene.model_copy(update={"weathering": None}))]
    grey = torch.tensor([0.18, 0.18, 0.18], device=renderer.device)
    return torch.cat([over(picture.image, picture.coverage, grey) for picture in pair], dim=1).cpu()
