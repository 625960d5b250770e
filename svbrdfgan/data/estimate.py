"""What a data set will look like and what it will take, from a few of its exemplars made in a temporary folder."""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.compositing import over
from svbrdfgan.data.config import DatasetConfig
from svbrdfgan.data.generate import exemplar_paths, generate, render_scene
from svbrdfgan.data.plan import make_plan
from svbrdfgan.data.studio import Studio, resolve_renderer

_TRANSPORT_BYTES = 55
"""For each pixel of a picture, in half precision. Measured on vehicles: 53 over 504 views at 64x64 and 32 samples,
55 over 2,028 views at 256x256."""


@dataclass(frozen=True)
class Needs:
    """What a data set takes: seconds of one process, bytes of disk and of memory."""

    exemplars: int
    meshes: int
    seconds: float
    disk: float
    transport: float
    memory: float


def estimate(config: DatasetConfig, base: Path) -> Needs:
    """Makes the exemplars of one mesh and multiplies."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        plan = make_plan(config, folder, base)
        samplers = [plan.sampler(split) for split in config.splits]
        exemplars, meshes = sum(map(len, samplers)), sum(len(sampler.meshes) for sampler in samplers)
        assets = sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())
        train = config.splits["train"]
        few = train.model_copy(update={"views": min(train.views, 4)})
        small = plan.model_copy(
            update={
                "config": config.model_copy(update={"splits": {"train": few}}),
                "meshes": {"train": plan.meshes["train"][:1]},
            }
        )
        (folder / "dataset.json").write_text(small.model_dump_json(), encoding="utf-8")
        began = time.monotonic()
        generate(small.config, folder, base=base)
        seconds = time.monotonic() - began
        picture = sum(exemplar_paths(folder, "train", n)[0].stat().st_size for n in range(few.views)) / few.views
        subject = sum(file.stat().st_size for file in (folder / "cache").rglob("*") if file.is_file())
    pixels, texels = config.image[0] * config.image[1], config.texture**2
    transport = 0 if config.maps else exemplars * pixels * _TRANSPORT_BYTES  # none is stored of what is not linear
    return Needs(
        exemplars=exemplars,
        meshes=meshes,
        seconds=seconds / few.views * exemplars,
        disk=assets + exemplars * (picture + 2048) + meshes * subject,
        transport=transport,
        memory=transport + exemplars * pixels * 20 + meshes * texels * 100,
    )


def preview(config: DatasetConfig, base: Path) -> Float[Tensor, "height width 3"]:
    """The first exemplar beside its unweathered twin, linear, before grey."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        scene = make_plan(config, folder, base).sampler("train").scene(0)
        studio, renderer = Studio(folder, keep=False), resolve_renderer(config.renderer)
        pair = [render_scene(studio, renderer, s) for s in (scene, scene.model_copy(update={"weathering": None}))]
    grey = torch.tensor([0.18, 0.18, 0.18], device=renderer.device)
    return torch.cat([over(picture.image, picture.coverage, grey) for picture in pair], dim=1).cpu()
