"""A training configuration with every decision taken, once, before anything is rendered."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import torch

from svbrdfgan.config.distributions import Fixed
from svbrdfgan.config.models import differences
from svbrdfgan.data.conditions import conditions_of
from svbrdfgan.data.config import DatasetConfig, Split
from svbrdfgan.data.index import Dataset
from svbrdfgan.data.trained_model import TrainedModel
from svbrdfgan.errors import ConfigError
from svbrdfgan.models.shipped import model_folder, shipped_models
from svbrdfgan.networks.conditions import Conditions
from svbrdfgan.networks.layers import LOCAL_NORMS
from svbrdfgan.networks.saved import GeneratorConfig
from svbrdfgan.scene.window import WHOLE
from svbrdfgan.training.config import ScenesConfig, TrainConfig, resolved
from svbrdfgan.utils.devices import Device, torch_device
from svbrdfgan.utils.torchrun import Rank

if TYPE_CHECKING:
    from lightning_fabric import Fabric


@dataclass(frozen=True, eq=False)
class ResolvedRun:
    """A run with all that it will do decided. Code below reads it, and opens and decides nothing again.

    Attributes:
        config: the configuration, with `discriminator.compares` and `discriminator.light_buffer` decided, and of what
            `init` or `refines` names: the generator's settings, and its name or whole path.
        dataset: the data set that it names, opened.
        base: the folder that file patterns of the configuration are relative to.
    """

    config: TrainConfig
    dataset: Dataset
    base: Path = Path()

    @property
    def deferred(self) -> bool:
        """Whether light is stored for layers of whole materials, in which pictures are not linear."""
        return self.config.rendering == "stored" and bool(self.dataset.config.maps)

    @property
    def conditions(self) -> Conditions:
        """The facts of each layer that generator and discriminator are told."""
        return conditions_of(self.config.generator, self.dataset.config)

    @property
    def layer_texels(self) -> int:
        """Texels along a side of the layers that are trained on."""
        return _layer_texels(self.dataset.config, "train")

    @property
    def fake_spp(self) -> int:
        """Samples in each pixel of a fake's learnable parts; the noise of a fake is that of this number."""
        return min(self.config.spp, self.config.hits) if self.deferred else self.config.spp

    def with_config(self, **update: object) -> ResolvedRun:
        """The same run with other values for some keys of its configuration."""
        return ResolvedRun(self.config.model_copy(update=update), self.dataset, self.base)

    def unperturbed(self) -> ResolvedRun:
        """The same run with its fakes in the exemplars' own scenes."""
        return self.with_config(scenes=ScenesConfig())


def resolve_run(config: TrainConfig, base: Path = Path()) -> ResolvedRun:
    """Opens the configuration's data set and decides what the configuration leaves open.

    Args:
        base: the folder that paths of the configuration are relative to.

    Raises:
        AssetError: the data set is missing, or of another version.
        ConfigError: this data set cannot do what the configuration asks.
    """
    dataset = Dataset.open((base / config.dataset).resolve())
    return ResolvedRun(resolve_config(config, dataset.config, base), dataset, base)


def resolve_config(config: TrainConfig, dataset: DatasetConfig, base: Path = Path()) -> TrainConfig:
    """The configuration with what it leaves open decided, for a data set that need not be there yet.

    Args:
        base: the folder that paths of the configuration are relative to.

    Raises:
        AssetError: the model that `init` or `refines` names cannot be read.
        ConfigError: such a data set cannot do what the configuration asks.
    """
    if config.init is not None:
        config = _from_model(config, config.init, base, dataset)
    elif config.refines is not None:
        config = _refining(config, config.refines, base, dataset)
    elif config.generator.refined is not None:
        raise ConfigError("generator.refined: `refines` fills it in; name the model there.")
    _require_divisible(config, dataset)
    for split in dataset.splits:
        _require_halvable(config, _layer_texels(dataset, split))
    if dataset.window is not None and config.generator.norm not in LOCAL_NORMS:
        raise ConfigError(
            f"generator.norm: {config.generator.norm} norms are taken over whole maps, and the data set's close-ups "
            "have windows: set generator.norm: pixel."
        )
    return resolved(config, dataset.spp, dataset.maps, imported=dataset.weathering is None)


def seeds_vary(dataset: DatasetConfig) -> bool:
    """Whether the true layers are a distribution: each exemplar's has a seed of its own."""
    return dataset.weathering is not None and not isinstance(dataset.weathering.seed, Fixed)


def learns_distribution(generator: GeneratorConfig, dataset: DatasetConfig) -> bool:
    """Whether a generator with random fields learns from true layers that are a distribution."""
    return generator.random_fields > 0 and seeds_vary(dataset)


def make_fabric(device: Device, *, devices: int = 1, precision: str = "auto", rank: Rank | None = None) -> Fabric:
    """Lightning Fabric for a configuration's `device`, `devices` and `precision`.

    Args:
        rank: of this process among the `devices` that torchrun has started; None: they are to be spawned.

    Raises:
        ConfigError: `device` is "cuda", and torch finds no GPU, or fewer than processes of this machine.
    """
    from lightning_fabric import Fabric  # imports torch's compiler, which takes more than a second
    from lightning_fabric.plugins.environments import TorchElasticEnvironment

    cuda = torch_device(device).type == "cuda"
    if precision == "auto":
        precision = "bf16-mixed" if cuda else "32-true"
    if rank is None:
        strategy = "ddp_spawn" if devices > 1 else "auto"
        return Fabric(accelerator=device, devices=devices, strategy=strategy, precision=precision)  # type: ignore[arg-type]  # one of its literals
    if cuda and rank.processes_here > torch.cuda.device_count():
        raise ConfigError(
            f"device: torchrun started {rank.processes_here} processes here, and torch sees "
            f"{torch.cuda.device_count()} GPUs: wanted at most one process for each."
        )
    return Fabric(
        accelerator=device,
        devices=rank.processes_here,
        num_nodes=devices // rank.processes_here,
        strategy="ddp",
        precision=precision,  # type: ignore[arg-type]  # one of its literals
        plugins=[TorchElasticEnvironment()],
    )


def _from_model(config: TrainConfig, init: str, base: Path, dataset: DatasetConfig) -> TrainConfig:
    """The configuration of a run that starts from a model, with the settings of that model's generator."""
    model = TrainedModel.open(model_folder(init, base), "init")
    wanted = config.generator if "generator" in config.model_fields_set else model.generator
    if changed := differences(wanted.model_dump(), model.generator.model_dump()):
        raise ConfigError(f"generator: the model that training starts from has other settings ({'; '.join(changed)}).")
    maps, known = (", ".join(("base_color", *names)) for names in (dataset.maps, model.trained_on.maps))
    if maps != known:
        raise ConfigError(f"init: the model paints {known}, and the layers of the data set have {maps}.")
    if not model.conditions.alike(conditions_of(model.generator, dataset)):
        raise ConfigError(
            "init: the model is told each layer's amount and recipe where they varied in its own data set; those of "
            "this one must vary likewise."
        )
    named = init if init in shipped_models() else str(model.folder.resolve())
    return config.model_copy(update={"generator": model.generator, "init": named})


def _refining(config: TrainConfig, refines: str, base: Path, dataset: DatasetConfig) -> TrainConfig:
    """The configuration of a run that refines a model's layers, with the settings of that model's generator."""
    model, own = TrainedModel.open(model_folder(refines, base), "refines"), config.generator
    if not dataset.windowed:
        raise ConfigError(
            "refines: layers are refined in windows: make a data set with camera.close_ups.window in every split."
        )
    texels = min(dataset.texture, WHOLE)
    if dataset.texture % texels:
        raise ConfigError(
            f"refines: the data set's texture has {dataset.texture} texels; wanted a multiple of {WHOLE}."
        )
    theirs = model.trained_on
    if theirs.window is not None or theirs.texture != texels:
        seen = f"maps of {theirs.texture} texels" if theirs.window is None else "windows"
        raise ConfigError(f"refines: the model learned from {seen}; wanted one that did from whole maps of {texels}.")
    if theirs.embedding != dataset.embedding or tuple(theirs.maps) != tuple(dataset.maps):
        raise ConfigError("refines: the model learned from a data set with another `embedding`, or with other `maps`.")
    if model.generator.mesh_maps != own.mesh_maps or (model.generator.random_fields and not own.random_fields):
        raise ConfigError("refines: the model reads mesh maps or random fields: set them for `generator`, too.")
    if not model.conditions.alike(conditions_of(own, dataset)):
        raise ConfigError("refines: what varies of amount and recipe must vary in the model's own data set likewise.")
    named = refines if refines in shipped_models() else str(model.folder.resolve())
    generator = own.model_copy(update={"refined": model.generator})
    return config.model_copy(update={"generator": generator, "refines": named})


def _require_divisible(config: TrainConfig, dataset: DatasetConfig) -> None:
    """Pictures that are linear in their textures are divided by their light; the light of others can be shown."""
    for name in ("light_buffer", "clean_picture"):
        if config.rendering == "stored" and getattr(config.discriminator, name) and not dataset.maps:
            raise ConfigError(
                f"discriminator.{name}: rendering: stored of base_color has discriminator.compares: reflectance "
                f"instead; set discriminator.{name}: false, or rendering: online."
            )
    if config.clean_spp is not None and not (config.rendering == "stored" and dataset.maps):
        raise ConfigError("clean_spp is for rendering: stored of whole materials: leave it out, or name `maps`.")
    if dataset.maps and config.discriminator.compares == "reflectance":
        raise ConfigError(
            "discriminator.compares: reflectance is for base_color alone, and the data set's layers paint "
            f"{', '.join(dataset.maps)} too: set discriminator.compares: radiance."
        )


def _layer_texels(dataset: DatasetConfig, split: Split) -> int:
    """Texels along a side of the layers of a split."""
    near = dataset.camera_of(split).close_ups
    if near is None or near.window is None:
        return dataset.texture
    if near.share < 1.0:
        raise ConfigError(
            f"the data set's close-ups of the split {split} have windows of {near.window} texels, and its other "
            "pictures whole layers, which a run cannot mix: make it with close_ups.share: 1, or without "
            "close_ups.window."
        )
    return near.window


def _require_halvable(config: TrainConfig, texture: int) -> None:
    halvings = config.generator.downsamplings
    if texture % (1 << halvings) or texture < 4 << halvings:
        raise ConfigError(
            f"generator.downsamplings: a texture of {texture} texels cannot be halved {halvings} times into 4 or more; "
            "set a smaller number, or make the data set with another texture."
        )
