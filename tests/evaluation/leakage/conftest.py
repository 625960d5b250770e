"""A data set of plain boxes, quick to render and many enough to judge a probe by."""

from collections.abc import Callable
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from svbrdfgan.config.models import validate
from svbrdfgan.data.config import DatasetConfig
from svbrdfgan.data.generate import generate
from svbrdfgan.io.gltf.surface_files import save_mesh_glb
from svbrdfgan.training.config import TrainConfig, train_config
from svbrdfgan.types import Mesh, Part

WARP = {"name": "warp", "device": "cpu"}
BOXES = {
    "seed": 3,
    "image": [32, 32],
    "texture": 16,
    "spp": 8,
    "renderer": WARP,
    "embedding": {"name": "hemispherical", "resolution": 16},
    "environments": {"procedural": {"count": 6, "seed": 1}},
    "environment_rows": 16,
    "splits": {"train": {"meshes": {"files": ["*.glb"]}, "views": 5}},
}
TRAINING = {"batch_size": 2, "renderer": WARP, "spp": 8, "device": "cpu"}


def box(width: float, height: float, length: float) -> Mesh:
    corners = product((-width / 2, width / 2), (0.2, height), (-length / 2, length / 2))
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))])
    return Mesh(np.array(list(corners)), faces, np.zeros(len(faces), dtype=np.int64), (Part("body"),))


@pytest.fixture(scope="session")
def boxes(built_once: Callable[[str, Callable[[Path], None]], Path]) -> Path:
    """Twenty boxes, five views of each. Cached transports may be added to it, and nothing else."""
    pytest.importorskip("warp", reason="the warp renderer needs warp-lang")

    return built_once("boxes", partial(fill_with_boxes, BOXES)) / "dataset"


@pytest.fixture(scope="session")
def glossy(built_once: Callable[[str, Callable[[Path], None]], Path]) -> Path:
    """The same boxes of all materials between matt paint and polished metal. Nothing may be added to it."""
    pytest.importorskip("warp", reason="the warp renderer needs warp-lang")
    gloss = {"roughness": {"uniform": [0.2, 0.6]}, "metallic": {"uniform": [0.0, 1.0]}, "normal": 0}
    return built_once("glossy boxes", partial(fill_with_boxes, BOXES | {"maps": gloss})) / "dataset"


@pytest.fixture(scope="session")
def few_boxes(built_once: Callable[[str, Callable[[Path], None]], Path]) -> Path:
    """Four of the boxes, where it does not matter what is found. Nothing may be added to it."""
    pytest.importorskip("warp", reason="the warp renderer needs warp-lang")
    return built_once("few boxes", partial(fill_with_boxes, BOXES, count=4)) / "dataset"


def fill_with_boxes(data: dict[str, Any], base: Path, count: int = 20) -> None:
    rng = np.random.default_rng(0)
    for number in range(count):
        save_mesh_glb(base / f"box{number:02d}.glb", box(*rng.uniform((1.5, 1.2, 3.5), (2.1, 2.0, 5.0))))
    generate(validate(DatasetConfig, data, "boxes"), base / "dataset", base=base)


@pytest.fixture(scope="session")
def training(request: pytest.FixtureRequest) -> Callable[..., TrainConfig]:
    """How to train on the boxes with a tiny discriminator, with changes."""

    def changed(
        compares: str = "radiance", gbuffer: bool = True, light_buffer: bool = False, **changes: object
    ) -> TrainConfig:
        discriminator = {
            "width": 8,
            "layers": 2,
            "compares": compares,
            "gbuffer": gbuffer,
            "light_buffer": light_buffer,
        }
        chosen = {"dataset": changes.get("dataset") or str(request.getfixturevalue("boxes"))}
        return train_config({"discriminator": discriminator, **TRAINING, **changes, **chosen}, "here")

    return changed
