"""Fixtures that every test may use."""

import copy
import importlib.util
import os
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from filelock import FileLock

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before torch loads: threads that wait for a busy core cost fiftyfold

QUICK_RENDERER: dict[str, Any] = (
    {"name": "warp", "device": "cpu"} if importlib.util.find_spec("warp") else {"name": "numpy"}
)
"""The quickest renderer of direct light on this machine's processor."""

TINY_DATASET: dict[str, Any] = {
    "seed": 3,
    "image": [32, 32],
    "texture": 32,
    "spp": 8,
    "renderer": QUICK_RENDERER,
    "embedding": {"name": "hemispherical", "resolution": 32},
    "environments": {"procedural": {"count": 3, "seed": 1}},
    "environment_rows": 16,
    "splits": {
        "train": {"meshes": {"procedural": {"count": 2, "seed": 1}}, "views": 3},
        "validation": {"meshes": {"procedural": {"count": 1, "seed": 2}}, "views": 2},
    },
}
TINY_TRAINING: dict[str, Any] = {
    "steps": 4,
    "batch_size": 2,
    "generator": {"width": 4, "blocks": 1},
    "discriminator": {"width": 4, "layers": 1},
    "renderer": QUICK_RENDERER,
    "spp": 8,
    "score_every": 2,
    "save_every": 2,
    "device": "cpu",
}


def merged(defaults: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """A deep copy of the defaults with the changes laid over them, mapping by mapping."""
    result = copy.deepcopy(defaults)
    for key, value in changes.items():
        below = result.get(key)
        result[key] = merged(below, value) if isinstance(below, dict) and isinstance(value, dict) else value
    return result


@pytest.fixture(scope="session")
def assets() -> Path:
    """The folder of real vehicles, environments and meshes, or a skip that says how to get it."""
    folder = os.environ.get("SVBRDFGAN_ASSETS")
    if not folder:
        pytest.skip(
            "SVBRDFGAN_ASSETS is not set: point it at a folder with cars/, envmaps/ and meshes/ to run this test"
        )
    return Path(folder)


@pytest.fixture(scope="session")
def ended() -> Callable[[int], bool]:
    """Whether the process of that number is gone, or a zombie that nobody has waited for, within some seconds."""

    def gone(pid: int) -> bool:
        stat = Path(f"/proc/{pid}/stat")
        return not stat.exists() or stat.read_text().rpartition(")")[2].split()[0] == "Z"

    def ended(pid: int) -> bool:
        until = time.monotonic() + 10
        while not gone(pid) and time.monotonic() < until:
            time.sleep(0.05)
        return gone(pid)

    return ended


@pytest.fixture(scope="session")
def quick_renderer() -> str:
    """The quickest renderer of direct light on this machine, for tests that are not about a renderer."""
    return str(QUICK_RENDERER["name"])


@pytest.fixture(scope="session")
def cpu_renderer() -> Any:
    """Likewise, made for the processor."""
    from svbrdfgan.plugins.registry import load_renderer

    options = dict(QUICK_RENDERER)
    return load_renderer(options.pop("name"), options)


@pytest.fixture(scope="session")
def quick_glossy_renderer() -> str:
    """The quickest renderer with roughness, likewise."""
    return "mitsuba" if importlib.util.find_spec("mitsuba") else "numpy"


@pytest.fixture(scope="session")
def dataset_data() -> Callable[..., dict[str, Any]]:
    """The tiny data set's configuration as in its YAML file, with changes laid over it."""
    return lambda **changes: merged(TINY_DATASET, changes)


@pytest.fixture(scope="session")
def training_data(tiny_dataset: Path) -> Callable[..., dict[str, Any]]:
    """A tiny run's configuration as in its YAML file, with changes laid over it."""
    return lambda **changes: merged({"dataset": str(tiny_dataset), **TINY_TRAINING}, changes)


@pytest.fixture(scope="session")
def van(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A procedural van as a GLB file. Not to be changed."""
    from svbrdfgan.io.gltf.surface_files import save_mesh_glb
    from svbrdfgan.procedural.kinds import sample_vehicle
    from svbrdfgan.procedural.vehicle import build_vehicle

    path = tmp_path_factory.mktemp("van") / "van.glb"
    save_mesh_glb(path, build_vehicle(sample_vehicle("van", 5)))
    return path


BuiltOnce = Callable[[str, Callable[[Path], None]], Path]


@pytest.fixture(scope="session")
def built_once(tmp_path_factory: pytest.TempPathFactory) -> BuiltOnce:
    """Fills a folder once for all workers of pytest-xdist, and gives this worker a copy of its own.

    A copy, since what is added to it, such as a cache, must not surprise the tests of another worker.
    """
    base = tmp_path_factory.getbasetemp()
    shared = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "shared"
    shared.mkdir(exist_ok=True)

    def built(name: str, fill: Callable[[Path], None]) -> Path:
        with FileLock(shared / f"{name}.lock"):
            if not (shared / name).exists():
                unfinished = tmp_path_factory.mktemp(name)
                fill(unfinished)
                shutil.copytree(unfinished, shared / f"{name}.partial")
                (shared / f"{name}.partial").rename(shared / name)
        return shutil.copytree(shared / name, tmp_path_factory.mktemp(name) / name)

    return built


@pytest.fixture(scope="session")
def tiny_dataset(built_once: BuiltOnce) -> Path:
    """Two procedural vehicles to train on and one to validate with, three and two views each. Not to be changed."""
    from svbrdfgan.config.models import validate
    from svbrdfgan.data.config import DatasetConfig
    from svbrdfgan.data.generate import generate

    def fill(folder: Path) -> None:
        generate(validate(DatasetConfig, TINY_DATASET, "tiny"), folder / "dataset", base=Path())

    return built_once("tiny", fill) / "dataset"


@pytest.fixture(scope="session")
def varied_dataset(built_once: BuiltOnce) -> Path:
    """The tiny data set with two recipes, and an amount and a seed of each exemplar's own. Not to be changed."""
    from svbrdfgan.config.models import validate
    from svbrdfgan.data.config import DatasetConfig
    from svbrdfgan.data.generate import generate

    varied = {"recipe": {"choice": ["rust", "dust"]}, "amount": {"uniform": [0.2, 1]}, "seed": {"uniform": [0, 999]}}

    def fill(folder: Path) -> None:
        declared = validate(DatasetConfig, merged(TINY_DATASET, {"weathering": varied}), "varied")
        generate(declared, folder / "dataset", base=Path())

    return built_once("varied", fill) / "dataset"


@pytest.fixture(scope="session")
def varied_run(built_once: BuiltOnce, varied_dataset: Path) -> Path:
    """A short run with random fields and conditions on the varied data set. Not to be changed."""
    from svbrdfgan.training.config import train_config
    from svbrdfgan.training.trainer import train

    varied = {"generator": {"random_fields": 3}, "optimizer": {"generator_rate": 1e-2}}

    def fill(folder: Path) -> None:
        changed = merged({"dataset": str(varied_dataset), **TINY_TRAINING}, varied)
        train(train_config(changed, "varied"), folder / "run")

    return built_once("varied_run", fill) / "run"


@pytest.fixture(scope="session")
def shipped_folder(built_once: BuiltOnce, varied_run: Path) -> Path:
    """The short run as the shipped model `corroded`, the only one in this folder. Not to be changed."""
    from PIL import Image

    from svbrdfgan.models.card import ModelCard, Scores, Source
    from svbrdfgan.training.ship import ship

    card = ModelCard(
        name="corroded",
        title="Corroded",
        about="Rust or dust, after four steps of training.",
        recipes=("rust", "dust"),
        data=(Source(name="two procedural vehicles", licence="Apache-2.0"),),
        command="svbrdfgan train tiny.yaml -o run",
        validation=Scores(resemblance=0.5),
        test=Scores(vehicles=1, resemblance=0.25, parts={"joint": 0.1, "mean": 0.4}, power=(0.5, 2.0)),
        limits=("Four steps teach next to nothing.",),
    )

    def fill(folder: Path) -> None:
        Image.new("RGB", (16, 9), "brown").save(folder / "picture.jpg")
        ship(varied_run, folder / "corroded", card, folder / "picture.jpg")

    return built_once("shipped", fill)


@pytest.fixture
def shipped(shipped_folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Makes `corroded` the only shipped model; returns its folder."""
    monkeypatch.setattr("svbrdfgan.models.shipped.FOLDER", shipped_folder)
    return shipped_folder / "corroded"


@pytest.fixture(scope="session")
def tiny_exemplars(tiny_dataset: Path) -> Any:
    """The training split of the tiny data set in memory. Not to be changed."""
    from svbrdfgan.data.exemplars import load_exemplars
    from svbrdfgan.data.index import Dataset

    return load_exemplars(Dataset.open(tiny_dataset), "train")


@pytest.fixture
def dataset_copy(tiny_dataset: Path, tmp_path: Path) -> Path:
    """The tiny data set, to be changed."""
    return shutil.copytree(tiny_dataset, tmp_path / "dataset")
