"""The folder of a run: its configuration, its checkpoints, its model, its log; and how a model is used again."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from svbrdfgan.compositing import RGBA
from svbrdfgan.data.config import DatasetConfig
from svbrdfgan.data.distributions import mean
from svbrdfgan.data.scene import load_json
from svbrdfgan.errors import AssetError, ConfigError
from svbrdfgan.io.atomic import atomic_path
from svbrdfgan.networks import Generator
from svbrdfgan.options import StrictModel, validate
from svbrdfgan.training.config import GeneratorConfig, TrainConfig

_FORMAT = "svbrdfgan generator 2"
CONFIG, MODEL, ORACLE, LOG = "config.json", "model.safetensors", "oracle.safetensors", "log.jsonl"


class RunConfig(StrictModel):
    """The contents of a run's `config.json`: everything resolved, so that the run says by itself what it was."""

    train: TrainConfig
    dataset: DatasetConfig
    dataset_folder: str
    versions: dict[str, str]

    @property
    def maps(self) -> dict[str, float]:
        """What layers paint beside base_color, and what usually lies beneath: the mean of what was learned on."""
        return {name: min(max(mean(value), 0.0), 1.0) for name, value in self.dataset.maps.items()}

    def save(self, run: Path) -> None:
        with atomic_path(run / CONFIG) as temporary:
            temporary.write_text(self.model_dump_json(indent=1) + "\n", encoding="utf-8")

    @classmethod
    def load(cls, run: Path) -> RunConfig:
        """Reads a run's configuration.

        Raises:
            AssetError: the folder is no run.
        """
        if not (run / CONFIG).is_file():
            raise AssetError(f"{run} is not a run: it has no {CONFIG}; make one with `svbrdfgan train`.")
        return validate(cls, load_json(run / CONFIG), str(run / CONFIG))

    def require_same(self, other: RunConfig) -> None:
        """Refuses to resume a run with what would not be the same run.

        Raises:
            ConfigError: anything but its length, its log and the machine differs.
        """
        free: dict[str, Any] = {"train": {"steps", "minutes", "score_every", "save_every", "device", "devices"}}
        free |= {"versions": True, "dataset_folder": True}
        mine, its = (config.model_dump(exclude=free) for config in (self, other))
        changed = sorted(_differences(mine, its))
        if changed:
            raise ConfigError(f"the run was started with other settings ({', '.join(changed)}); start a new one.")


@dataclass(frozen=True, eq=False)
class Model:
    """A trained generator and what it must be fed with: the embedding and the texture size it learned on."""

    generator: Generator
    config: RunConfig
    score: float | None


def save_generator(path: Path, generator: Generator, config: GeneratorConfig, score: float | None) -> None:
    """Writes a generator's weights with what is needed to build it."""
    meta = {"format": _FORMAT, "generator": config.model_dump_json(), "score": json.dumps(score)}
    meta["channels"] = json.dumps(generator.channels)
    tensors = {name: tensor.detach().cpu().contiguous() for name, tensor in generator.state_dict().items()}
    with atomic_path(path) as temporary:
        save_file(tensors, temporary, meta)


def load_generator(path: Path) -> tuple[Generator, float | None]:
    """Reads what `save_generator` wrote, and its validation score.

    Raises:
        AssetError: missing, damaged, or of another kind.
    """
    try:
        with safe_open(path, framework="pt") as file:
            meta = file.metadata() or {}
            if meta.get("format") != _FORMAT:
                raise AssetError(f"{path} is not a generator of this version; train it anew.")
            weights: dict[str, Tensor] = {n: file.get_tensor(n) for n in file.keys()}  # noqa: SIM118
    except (OSError, SafetensorError) as error:
        raise AssetError(f"{path} cannot be read ({error}); train the run until it has saved a model.") from error
    built = validate(GeneratorConfig, json.loads(meta["generator"]), str(path)).model_dump()
    generator = Generator(**built, channels=json.loads(meta.get("channels", str(RGBA))))
    generator.load_state_dict(weights)
    return generator.eval().requires_grad_(False), json.loads(meta["score"])


def load_model(run: Path) -> Model:
    """The best generator of a run, by its validation score.

    Raises:
        AssetError: the folder is no run, or has no model yet.
    """
    config = RunConfig.load(run)
    generator, score = load_generator(run / MODEL)
    return Model(generator, config, score)


def versions() -> dict[str, str]:
    """Of what results may depend on."""
    import platform

    import numpy

    import svbrdfgan

    return {
        "svbrdfgan": svbrdfgan.__version__,
        "torch": torch.__version__,
        "numpy": numpy.__version__,
        "python": platform.python_version(),
    }


def _differences(mine: dict[str, Any], its: dict[str, Any], path: str = "") -> list[str]:
    found: list[str] = []
    for key in mine.keys() | its.keys():
        a, b, name = mine.get(key), its.get(key), f"{path}{key}"
        if isinstance(a, dict) and isinstance(b, dict):
            found += _differences(a, b, f"{name}.")
        elif a != b:
            found.append(name)
    return found
