"""The state of a run: networks, optimizers and counters, and its checkpoints."""

from __future__ import annotations

import copy
import json
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import torch
from jaxtyping import Float
from pydantic import Field, field_validator
from safetensors import SafetensorError
from safetensors.torch import load_file, save
from torch import Tensor, nn
from torch.optim.swa_utils import get_ema_multi_avg_fn

from svbrdfgan.config.models import StrictModel
from svbrdfgan.errors import AssetError, ConfigError, TrainingError
from svbrdfgan.io.atomic import atomic_folder
from svbrdfgan.io.records import load_record
from svbrdfgan.networks.discriminator import Discriminator
from svbrdfgan.networks.generator import Generator
from svbrdfgan.networks.layers import initialise
from svbrdfgan.networks.saved import make_generator
from svbrdfgan.training.all_reduce import GradientAllReduce
from svbrdfgan.training.config import DiscriminatorConfig, TrainConfig
from svbrdfgan.training.reference_pictures import LIGHT_CHANNELS
from svbrdfgan.training.refined_layers import RefinedLayers

RGB = 3
"""Channels of a picture."""
_COUNTERS = "state.json"
_NUMBERED = re.compile(r"step_\d{1,12}")
_KEEP = 2
"""Checkpoints of a run: the one before serves if the last is damaged."""
_GBUFFER = 6
"""Channels of position and normal."""
_TOLD_APART = 0.57  # of the pairs: a discriminator that tells more apart has begun to know its exemplars by heart
_ACCURACY_IMAGES = 500  # half-life of the mean accuracy
_AUGMENTED_IMAGES = 4000  # that take the share of augmented pairs from 0 to 1, or back


class _Counters(StrictModel):
    """What a checkpoint holds besides tensors; see `State`."""

    step: int = Field(ge=0)
    seconds: float = Field(ge=0.0)
    best: tuple[Annotated[float, Field(allow_inf_nan=True)], int]
    history: list[dict[str, float]]

    @field_validator("history")
    @classmethod
    def _counts(cls, history: list[dict[str, float]]) -> list[dict[str, float]]:
        if not all({"step", "seconds"} <= point.keys() for point in history):
            raise ValueError("each entry needs step and seconds")
        return history


@dataclass(eq=False)
class State:
    """Everything that a training step changes.

    Attributes:
        averaged: the generator's exponential moving average; it is scored and saved.
        step: generator updates done.
        seconds: training time spent, over all resumptions.
        best: the best validation score so far, and at which step.
        accuracy: the mean share of recent pairs that the discriminator told apart.
        augmented: the share of pairs that are augmented, on the device, as `accuracy`.
        refined: the layers that the generator refines, if it does.
    """

    generator: Generator
    discriminator: Discriminator
    averaged: Generator
    generator_adam: torch.optim.Adam
    discriminator_adam: torch.optim.Adam
    generator_gradients: GradientAllReduce
    discriminator_gradients: GradientAllReduce
    accuracy: Float[Tensor, ""]
    augmented: Float[Tensor, ""]
    refined: RefinedLayers | None = None
    step: int = 0
    seconds: float = 0.0
    best: tuple[float, int] = (-float("inf"), 0)
    history: list[dict[str, float]] = field(default_factory=list)

    @classmethod
    def fresh(
        cls,
        config: TrainConfig,
        device: torch.device,
        maps: tuple[str, ...] = (),
        processes: int = 1,
        labels: int = 0,
        judged: int = RGB,
    ) -> State:
        """The state before the first step, for layers with these further maps; the same for a seed on any device.

        Args:
            processes: number that share each step.
            labels: numbers that both networks are told of each layer (`Conditions.labels`).
            judged: channels of what the discriminator judges, besides those of buffers and labels.
        """
        rng = torch.Generator().manual_seed(config.seed)
        generator = make_generator(config.generator, maps, labels)
        discriminator = make_discriminator(config.discriminator, labels, judged)
        initialise(generator, rng)
        initialise(discriminator, rng, config.discriminator.weights)
        refined = None
        if generator.refined is not None:
            generator.start_refining()
            refined = RefinedLayers(generator)
        for network in (generator, discriminator):
            network.to(device, memory_format=torch.channels_last)  # type: ignore[call-overload]  # torch's stubs lack it
        trained = [parameter for parameter in generator.parameters() if parameter.requires_grad]
        adam, betas = config.optimizer, (config.optimizer.beta1, config.optimizer.beta2)
        return cls(
            generator=generator,
            discriminator=discriminator,
            averaged=copy.deepcopy(generator).requires_grad_(False),
            generator_adam=torch.optim.Adam(trained, adam.generator_rate, betas, fused=True),
            discriminator_adam=torch.optim.Adam(discriminator.parameters(), adam.discriminator_rate, betas, fused=True),
            generator_gradients=GradientAllReduce(generator, processes),
            discriminator_gradients=GradientAllReduce(discriminator, processes),
            accuracy=torch.tensor(0.5, device=device),
            augmented=torch.tensor(0.0, device=device),
            refined=refined,
        )

    def start_from(self, generator: Generator) -> None:
        """Takes the weights of a generator of the same configuration, before the first step."""
        for own in (self.generator, self.averaged):
            own.load_state_dict(generator.state_dict())

    def take_refined(self, refined: Generator) -> None:
        """Takes the weights of the generator whose layers are refined, before the first step."""
        for own in (self.generator, self.averaged):
            assert own.refined is not None
            own.refined.load_state_dict(refined.state_dict())

    def average(self, batch_size: int, half_life: float) -> None:
        """Moves the averaged generator towards the current one: half the way in `half_life` images, faster at first."""
        half_life = min(half_life, 0.1 * self.step * batch_size)
        keep = 0.5 ** (batch_size / half_life) if half_life > 0 else 0.0
        means, now = list(self.averaged.parameters()), list(self.generator.parameters())
        get_ema_multi_avg_fn(keep)(means, now, None)

    def adapt(self, accuracy: Float[Tensor, ""], batch_size: int) -> None:
        """Augments more pairs if the discriminator tells more than 0.57 of them apart, and else fewer.

        So augmentation sets in when exemplars are too few, and slows nothing before (Karras et al. 2020). Nothing waits
        for the device.

        Args:
            accuracy: the share of the step's pairs that the discriminator told apart.
        """
        self.accuracy.lerp_(accuracy, 1.0 - 0.5 ** (batch_size / _ACCURACY_IMAGES))
        change = torch.sign(self.accuracy - _TOLD_APART) * (batch_size / _AUGMENTED_IMAGES)
        self.augmented.add_(change).clamp_(0.0, 1.0)

    def save(self, folder: Path) -> None:
        """Writes a checkpoint, a folder that appears whole or not at all, and keeps the latest two.

        Raises:
            AssetError: it cannot be written.
        """
        counters = {"step": self.step, "seconds": self.seconds, "best": self.best, "history": self.history}
        with atomic_folder(checkpoint_path(folder, self.step)) as temporary:
            # not save_file, which reports a full disk as an error of its own
            (temporary / "state.safetensors").write_bytes(save(self._tensors()))
            (temporary / _COUNTERS).write_text(json.dumps(counters), encoding="utf-8")
        for old in checkpoints(folder)[:-_KEEP]:
            shutil.rmtree(old, ignore_errors=True)

    def load(self, checkpoint: Path) -> None:
        """Continues from a checkpoint.

        Raises:
            AssetError: it is damaged.
            TrainingError: it is of other networks.
        """
        tensors, counters = _read(checkpoint)
        with _of_these_networks(checkpoint):
            for name, network in self._networks().items():
                network.load_state_dict(_under(f"{name}.", tensors))
            for name, adam in self._optimizers().items():
                moments = _under(f"{name}.", tensors)
                if counters.step and not moments:
                    raise ValueError(f"it has no {name}")
                _load_adam(adam, moments)
            for own in ("accuracy", "augmented"):
                getattr(self, own).copy_(tensors[own])
        self.step, self.seconds = counters.step, counters.seconds
        self.best, self.history = counters.best, counters.history

    def _networks(self) -> dict[str, nn.Module]:
        return {"generator": self.generator, "discriminator": self.discriminator, "averaged": self.averaged}

    def _optimizers(self) -> dict[str, torch.optim.Adam]:
        return {"generator_adam": self.generator_adam, "discriminator_adam": self.discriminator_adam}

    def _tensors(self) -> dict[str, Tensor]:
        tensors = {f"{n}.{k}": v for n, network in self._networks().items() for k, v in network.state_dict().items()}
        for name, adam in self._optimizers().items():
            for number, moments in adam.state_dict()["state"].items():
                tensors |= {f"{name}.{number}.{key}": value for key, value in moments.items()}
        tensors |= {"accuracy": self.accuracy, "augmented": self.augmented}
        return {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}


def load_discriminator(checkpoint: Path, config: DiscriminatorConfig, labels: int = 0) -> tuple[Discriminator, int]:
    """The discriminator of a checkpoint, on the CPU, and the checkpoint's step.

    Args:
        labels: numbers that it is told of each layer.

    Raises:
        AssetError: the checkpoint is damaged.
        TrainingError: it is of another network.
    """
    tensors, counters = _read(checkpoint)
    discriminator = make_discriminator(config, labels)
    with _of_these_networks(checkpoint):
        discriminator.load_state_dict(_under("discriminator.", tensors))
    return discriminator.eval().requires_grad_(False), counters.step


def make_discriminator(config: DiscriminatorConfig, labels: int = 0, judged: int = RGB) -> Discriminator:
    """The network for what it judges, such as colour, for the buffers that it is shown, and one for each label."""
    buffers = (
        _GBUFFER * config.gbuffer
        + LIGHT_CHANNELS * config.light_buffer
        + RGB * config.clean_picture * (1 + config.octaves)
    )
    channels = judged + buffers + config.pixel_size + labels
    return Discriminator(channels=channels, **config.model_dump(include={"width", "layers", "norm"}))


def checkpoint_path(folder: Path, step: int) -> Path:
    return folder / "checkpoints" / f"step_{step:08d}"


def checkpoints(folder: Path) -> list[Path]:
    """The complete checkpoints of a run, oldest first."""
    return sorted(path for path in (folder / "checkpoints").glob("step_*") if _NUMBERED.fullmatch(path.name))


def step_of(checkpoint: Path) -> int:
    """The generator updates before the checkpoint."""
    return int(checkpoint.name.removeprefix("step_"))


def progress_of(checkpoint: Path) -> tuple[int, float]:
    """The steps and seconds of training before the checkpoint.

    Raises:
        AssetError: it is damaged.
    """
    counters = load_record(_Counters, checkpoint / _COUNTERS)
    return counters.step, counters.seconds


def _read(checkpoint: Path) -> tuple[dict[str, Tensor], _Counters]:
    """The tensors and the counters of a checkpoint."""
    try:
        tensors = load_file(checkpoint / "state.safetensors")
        counters = load_record(_Counters, checkpoint / _COUNTERS)
        if counters.step != step_of(checkpoint):
            raise ValueError(f"its counters are of step {counters.step}")
        return tensors, counters
    except (OSError, ValueError, SafetensorError, AssetError, ConfigError) as error:
        reason = " ".join(str(error).split()).rstrip(".")
        raise AssetError(f"{checkpoint} is damaged ({reason}); delete it to resume from the one before.") from error


@contextmanager
def _of_these_networks(checkpoint: Path) -> Iterator[None]:
    try:
        yield
    except (KeyError, RuntimeError, ValueError) as error:
        raise TrainingError(f"{checkpoint} is of other networks than the configuration's: {error}") from error


def _load_adam(adam: torch.optim.Adam, tensors: dict[str, Tensor]) -> None:
    state: dict[int, dict[str, Any]] = {}
    for name, tensor in tensors.items():
        number, key = name.split(".", 1)
        state.setdefault(int(number), {})[key] = tensor
    adam.load_state_dict({"state": state, "param_groups": adam.state_dict()["param_groups"]})
    for parameter, moments in adam.state.items():  # fused Adam needs the parameter's strides, which files do not store
        alike = {key: value for key, value in moments.items() if value.shape == parameter.shape}
        moments.update({key: torch.empty_like(parameter).copy_(value) for key, value in alike.items()})


def _under(prefix: str, tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    return {name.removeprefix(prefix): tensor for name, tensor in tensors.items() if name.startswith(prefix)}
