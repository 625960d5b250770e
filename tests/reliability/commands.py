"""The commands with small inputs, and what must come out of each, however it was disturbed."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from PIL import Image

from svbrdfgan.io.gltf.surface_files import save_mesh_glb
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.vehicle import build_vehicle


@dataclass(frozen=True)
class Command:
    """A command as it is typed in a folder that holds copies of some inputs.

    Attributes:
        again: the words with which it goes on; by default the same.
        needs: entries of the inputs.
        results: patterns of files that are the same, byte for byte, however often the command was stopped.
        writes: the folder that it writes into, as patterns of what is made read-only; empty if it writes nothing.
        claims: what it claims, so that two cannot work on it at once.
        long: whether it takes minutes, so that it is disturbed in its first seconds and is not run again.
    """

    words: str
    again: str = ""
    needs: tuple[str, ...] = ()
    results: tuple[str, ...] = ()
    writes: str = "out"
    claims: str = ""
    long: bool = False


_DATASET = ("dataset.yaml",)
_RUN = ("data", "run")
_ALL = ("out/**/*",)

OFTEN = {
    "dataset": Command("dataset dataset.yaml -o out --workers 2", needs=_DATASET, results=_ALL, claims="out"),
    "dataset shard": Command(
        "dataset dataset.yaml -o out --workers 2 --shard 1/2", needs=_DATASET, results=_ALL, claims="out/shards/1-of-2"
    ),
    "train": Command(
        "train train.yaml -o out",
        "train train.yaml -o out --resume",
        needs=("data", "train.yaml"),
        results=("out/model.safetensors", "out/checkpoints/step_00000040/state.safetensors"),
        claims="out",
    ),
    "evaluate": Command(
        "evaluate run --no-oracle --workers 2",
        needs=_RUN,
        results=("run/evaluation.json",),
        writes="run",
        claims="run/config.json",
    ),
    "experiment": Command(
        "experiment small.yaml -o out",
        needs=("small.yaml",),
        # not its tables, which tell seconds
        results=("out/runs/*/model.safetensors", "out/runs/*/strip.png", "out/small/pictures.png"),
        claims="out",
    ),
    "texture": Command(
        "texture van.glb --model run --resolution 64 -o out/van.glb",
        "texture van.glb --model run --resolution 64 -o out/van.glb --force",
        needs=("van.glb", "run"),
        results=_ALL,
    ),
    "weather": Command(
        "weather van.glb --recipe rust --resolution 64 -o out/van.glb",
        "weather van.glb --recipe rust --resolution 64 -o out/van.glb --force",
        needs=("van.glb",),
        results=_ALL,
    ),
}
"""Those that work for long, or whose results are dear."""

SELDOM = {
    "demo": Command("demo --out out", claims="out", long=True),
    "backends": Command("backends", writes=""),
    "embeddings": Command("embeddings", writes=""),
    "check": Command("check hemispherical", writes="", long=True),
    "bake": Command("bake van.glb -o out", needs=("van.glb",), results=("out/*.exr",)),
    "parts": Command("parts van.glb --picture out/parts.png", needs=("van.glb",), results=_ALL),
    "dataset merge": Command("dataset merge data", needs=("data",), results=("data/dataset.json",), writes=""),
    "dataset import": Command(
        "dataset import manifest.yaml -o out", needs=("manifest.yaml", "van.glb", "van.png", "mask.png"), claims="out"
    ),
    "probe": Command("probe train.yaml", needs=("data", "train.yaml"), writes=""),
    "learn": Command(
        "learn manifest.yaml train.yaml -o out",
        needs=("manifest.yaml", "van.glb", "van.png", "mask.png", "train.yaml"),
        claims="out",
        long=True,
    ),
    "view": Command("view van.glb --recipe rust --page out/page.html", needs=("van.glb",), long=True),
    "models": Command("models", writes=""),
    "render": Command("render data/test/000000.json -o out/a.png", needs=("data",), results=_ALL),
    "bench": Command(
        "bench --backend warp --spp 1 --repeats 1 --vertices 100 --pixels 16 --texels 16 -o out", long=True
    ),
}
"""All others that need no further program."""

COMMANDS = OFTEN | SELDOM

_SHARED: dict[str, Any] = {
    "seed": 3,
    "image": [16, 16],
    "texture": 16,
    "spp": 4,
    "renderer": {"name": "warp", "device": "cpu"},
    "embedding": {"name": "hemispherical", "resolution": 16},
    "environments": {"procedural": {"count": 1, "seed": 1}},
    "environment_rows": 8,
}
_SPLITS: dict[str, Any] = {
    split: {"meshes": {"procedural": {"count": count, "seed": seed}}, "views": 3}
    for seed, (split, count) in enumerate({"train": 2, "validation": 1, "test": 1}.items())
}
DATASET: dict[str, Any] = {**_SHARED, "splits": _SPLITS}
TRAIN: dict[str, Any] = {
    "steps": 40,
    "batch_size": 2,
    "generator": {"width": 4, "blocks": 1},
    "discriminator": {"width": 4, "layers": 1},
    "renderer": {"name": "warp", "device": "cpu"},
    "spp": 4,
    "score_every": 10,
    "save_every": 5,
    "device": "cpu",
}
_EXPERIMENT: dict[str, Any] = {
    "title": "Small",
    "figure": "none",
    "thesis": "None.",
    "recipes": {"default": [0]},
    "rows": {"small": {"about": "All is small."}},
    "cpu": {
        "dataset": {**_SHARED, "image": [32, 32], "splits": _SPLITS},
        "train": {**TRAIN, "minutes": None, "steps": 8},
    },
}
_MANIFEST: dict[str, Any] = {
    "pictures": [
        {
            "file": "van.png",
            "mesh": "van.glb",
            "mask": "mask.png",
            "camera": {"azimuth_degrees": 90, "elevation_degrees": 10, "distance": 1.8, "target": [0, 0.2, 0]},
        }
    ],
    "light": "mean",
    **{key: _SHARED[key] for key in ("image", "texture", "renderer", "embedding", "environments", "environment_rows")},
}


def write_inputs(folder: Path) -> None:
    """Files alone; `data` and `run` are made of them by commands."""
    for name, data in {
        "dataset": DATASET,
        "train": {"dataset": "data", **TRAIN},
        "small": _EXPERIMENT,
        "manifest": _MANIFEST,
    }.items():
        (folder / f"{name}.yaml").write_text(json.dumps(data))  # JSON is YAML
    save_mesh_glb(folder / "van.glb", build_vehicle(sample_vehicle("van", 5)))
    Image.new("RGB", (48, 48), (120, 120, 120)).save(folder / "van.png")
    mask = Image.new("L", (48, 48), 0)
    for box in ((11, 16, 45, 22), (2, 22, 46, 34)):  # what the camera sees of the van, so that nobody is warned
        mask.paste(255, box)
    mask.save(folder / "mask.png")
