"""The configuration of a training run, as written in YAML."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, Literal

from pydantic import Field, model_validator

from svbrdfgan.config.choices import PluginChoice, PluginField
from svbrdfgan.config.models import StrictModel, validate
from svbrdfgan.data.config import CameraDistribution, EnvironmentSource
from svbrdfgan.networks.layers import Norm
from svbrdfgan.networks.saved import GeneratorConfig


class DiscriminatorConfig(StrictModel):
    """See `svbrdfgan.networks.discriminator.Discriminator`.

    `guide` shows it a G-buffer: the position and normal of each pixel.
    `light` shows it a light buffer: how each picture's scene lights a matt and two metallic reference materials (see
    `svbrdfgan.training.reference_pictures`). It is for pictures that cannot be divided by their light.

    `sees: reflectance` removes light, camera and noise from the comparison (see `svbrdfgan.training.step.make_pair`);
    `auto` decides between the two (see `resolved`).
    """

    width: int = Field(default=64, ge=4)
    layers: int = Field(default=3, ge=1, le=5)
    norm: Norm = "none"
    guide: bool = True
    light: bool = False
    sees: Literal["auto", "radiance", "reflectance"] = "auto"


class LossConfig(StrictModel):
    """The GAN loss and its penalties (thesis 4.3.2, 5.3)."""

    name: Literal["vanilla", "lsgan", "wgan", "relativistic"] = "vanilla"
    r1: float = Field(default=0.1, ge=0, description="weight of half |gradient|^2 per logit on real pictures")
    r2: float = Field(default=0.0, ge=0, description="likewise on fakes")
    gradient_penalty: float = Field(default=0.0, ge=0, description="WGAN-GP's lambda")
    penalty_every: int = Field(default=8, ge=1, description="steps; the weight grows likewise")
    critic_steps: int = Field(default=1, ge=1, description="discriminator updates for each of the generator")


class OptimizerConfig(StrictModel):
    """Adam for both networks, and the generator's average."""

    generator_rate: float = Field(default=2e-4, gt=0)
    discriminator_rate: float = Field(default=2e-4, gt=0)
    beta1: float = Field(default=0.5, ge=0, lt=1)
    beta2: float = Field(default=0.99, ge=0, lt=1)
    ema_images: float = Field(
        default=4000.0, ge=0, description="half-life of the averaged generator, in images; 0: none"
    )


class ScenesConfig(StrictModel):
    """The scenes that fakes are rendered in: those of the exemplars, perturbed (thesis 5.1, 5.2)."""

    camera_noise_degrees: float = Field(default=0.0, ge=0, description="uniform, on azimuth and elevation, either way")
    camera: CameraDistribution | None = Field(default=None, description="draws each camera, instead of the exemplar's")
    environment: Literal["same", "redrawn"] | EnvironmentSource = "same"
    pool: int = Field(default=1, ge=0, description="perturbed scenes stored per exemplar; 0: a new one at every visit")

    @property
    def same_camera(self) -> bool:
        return self.camera_noise_degrees == 0 and self.camera is None

    @property
    def matched(self) -> bool:
        return self.same_camera and self.environment == "same"


RECIPES: dict[str, dict[str, Any]] = {
    "default": {},
    # Thesis 4.3: WGAN-GP with five critic steps, batch 1, its networks. What it leaves out is as in its code base.
    "thesis": {
        "batch_size": 1,
        "loss": {"name": "wgan", "r1": 0.0, "gradient_penalty": 10.0, "penalty_every": 1, "critic_steps": 5},
        "discriminator": {"guide": False, "norm": "none", "sees": "radiance"},
        "generator": {"norm": "instance", "upsampling": "strided"},
        "optimizer": {"beta1": 0.5, "beta2": 0.999, "ema_images": 0.0},
    },
}
"""Defaults of each recipe, for keys that the configuration leaves out."""

_FRESH: dict[str, Any] = {"discriminator": {"guide": False}}
"""Defaults of `rendering: fresh`, where a G-buffer costs three more pictures of each fake in another camera."""


class TrainConfig(StrictModel):
    """A whole training run. Keys that are left out have the defaults of the recipe and the rendering (`RECIPES`)."""

    dataset: str
    recipe: Literal["default", "thesis"] = "default"
    seed: int = Field(default=0, ge=0, lt=2**63)
    steps: int = Field(default=20000, ge=1)
    minutes: float | None = Field(default=None, gt=0, description="stop earlier, after so much training time")
    batch_size: int = Field(default=16, ge=1)
    generator: GeneratorConfig = GeneratorConfig()
    discriminator: DiscriminatorConfig = DiscriminatorConfig()
    loss: LossConfig = LossConfig()
    optimizer: OptimizerConfig = OptimizerConfig()
    scenes: ScenesConfig = ScenesConfig()
    renderer: PluginField = PluginChoice(name="auto")
    rendering: Literal["transport", "fresh"] = "transport"
    spp: int = Field(default=64, ge=1, description="samples per pixel of the pictures trained through")
    hits: int = Field(default=64, ge=1, description="the most of them that are stored, for layers of whole materials")
    spp_grad: int | None = Field(default=None, ge=1, description="of their gradients; fresh rendering only")
    device: Literal["auto", "cpu", "cuda"] = "auto"
    devices: int = Field(default=1, ge=1)
    precision: Literal["auto", "32-true", "bf16-mixed"] = "auto"
    score_every: int = Field(default=500, ge=1)
    save_every: int = Field(default=1000, ge=1)

    @model_validator(mode="after")
    def _filled(self) -> TrainConfig:
        for defaults in (_FRESH if self.rendering == "fresh" else {}, RECIPES[self.recipe]):
            for name, default in defaults.items():
                value = getattr(self, name)
                if isinstance(value, StrictModel):
                    default = value.model_copy(update={k: default[k] for k in default.keys() - value.model_fields_set})
                elif name in self.model_fields_set:
                    continue
                object.__setattr__(self, name, default)  # a validator's return would not reach the constructor
        return self

    @model_validator(mode="after")
    def _possible(self) -> TrainConfig:
        if self.rendering != "transport" and self.discriminator.sees == "reflectance":
            raise ValueError("discriminator.sees: reflectance needs rendering: transport, which knows the light")
        if self.spp_grad is not None and self.rendering == "transport":
            raise ValueError(
                "spp_grad needs rendering: fresh; stored light has a gradient on the picture's own samples"
            )
        if self.batch_size % self.devices:
            raise ValueError(f"batch_size {self.batch_size} cannot be shared out among {self.devices} devices evenly")
        if self.loss.gradient_penalty and self.discriminator.norm == "instance":
            raise ValueError("loss.gradient_penalty needs discriminator.norm none or group")
        return self

    @property
    def images_per_step(self) -> int:
        """Exemplars that a step shows the discriminator, in all its updates."""
        return self.batch_size * self.loss.critic_steps


def train_config(data: dict[str, Any], source: str) -> TrainConfig:
    """The configuration that the data describe; `source` opens every message.

    Raises:
        ConfigError: one line for each fault.
    """
    return validate(TrainConfig, data, source)


def resolved(config: TrainConfig, spp: int, maps: Collection[str] = ()) -> TrainConfig:
    """The configuration with `discriminator.sees` decided.

    `auto` means radiance where fakes have their exemplars' scenes and samples per pixel, since then only texture
    tells them apart, and where pictures cannot be divided by their light: with `rendering: fresh`, or if layers paint
    further maps. Elsewhere it means reflectance.

    Args:
        spp: samples per pixel of the exemplars.
        maps: maps that layers paint beside base_color.
    """
    discriminator = config.discriminator
    if discriminator.sees != "auto":
        return config
    indivisible = bool(maps) or config.rendering != "transport"
    plain = indivisible or (config.scenes.matched and config.spp == spp)
    sees = "radiance" if plain else "reflectance"
    return config.model_copy(update={"discriminator": discriminator.model_copy(update={"sees": sees})})
