"""The configuration of a training run, as written in YAML."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, Literal

from pydantic import Field, model_validator

from svbrdfgan.config.choices import MOST_SAMPLES, PluginChoice, PluginField
from svbrdfgan.config.models import StrictModel, validate
from svbrdfgan.data.config import CameraDistribution, EnvironmentSource
from svbrdfgan.networks.layers import Norm, Weights
from svbrdfgan.networks.saved import GeneratorConfig
from svbrdfgan.utils.devices import Device


class DiscriminatorConfig(StrictModel):
    """The PatchGAN of thesis 4.3.1, which compares pictures (`svbrdfgan.networks.discriminator.Discriminator`)."""

    width: int = Field(default=64, ge=4, description="channels after its first convolution")
    layers: int = Field(
        default=3, ge=1, le=5, description="strided convolutions: patches have 70 pixels with 3, 34 with 2, 16 with 1"
    )
    norm: Norm = Field(default="none", description="a gradient penalty needs another than `instance`")
    weights: Weights = Field(
        default="normal",
        description="its first weights: `normal`, from N(0, 0.02), as in the thesis; `he`, which keep the size of "
        "their input (He et al. 2015), so that it tells fakes apart sooner; a larger `loss.r1` may be needed",
    )
    gbuffer: bool = Field(
        default=True,
        description="shows it a G-buffer, the position and normal at each pixel; `false` by default with `rendering: "
        "online`, where each fake in another camera costs three more pictures",
    )
    light_buffer: bool = Field(
        default=False,
        description="shows it a light buffer, for pictures that cannot be divided by their light (data sets with "
        "`maps`, or `rendering: online`): how each picture's scene lights one matt and two metallic white materials; "
        "with `online`, in scenes that are not matched, each fake costs three more pictures",
    )
    clean_picture: bool = Field(
        default=False,
        description="shows it how each picture differs from one of the same scene without the layer, which else it has "
        "to guess (with `rendering: online` or data sets with `maps`); needs base materials that are known",
    )
    octaves: int = Field(
        default=0,
        ge=0,
        le=6,
        description="with `clean_picture`, shows it so many octaves of the difference, too, from the second finest on, "
        "each at eight times its contrast: detail is faint beside the layer itself. Fakes must have the exemplars' "
        "noise ([close-ups](commands.md#close-ups))",
    )
    pixel_size: bool = Field(
        default=False,
        description="shows it how large a pixel is on the surface, for data sets in which [close-ups](commands.md"
        "#close-ups) come from various distances",
    )
    augment: bool = Field(
        default=True,
        description="mirrors and turns exemplars and their fakes at random, both alike: as many of them as it takes "
        "that no more than 0.57 of the pairs are told apart, so that it does not know few exemplars by heart",
    )
    compares: Literal["auto", "radiance", "reflectance"] = Field(
        default="auto",
        description="`radiance`: the plain pictures; `reflectance`: pictures divided by their light and reprojected "
        "into the exemplar's camera, without noise; `auto`: `radiance` if every fake has its exemplar's own scene and "
        "`spp` and was not imported, with `rendering: online`, or if the data set has `maps`; else `reflectance`",
    )

    @model_validator(mode="after")
    def _possible(self) -> DiscriminatorConfig:
        if self.octaves and not self.clean_picture:
            raise ValueError("octaves are those of the difference to a clean picture; clean_picture: true shows it one")
        return self

    @property
    def shows_buffers(self) -> bool:
        """Whether it is shown anything of the scene besides its picture."""
        return self.gbuffer or self.light_buffer or self.clean_picture


class LossConfig(StrictModel):
    """The GAN loss and its penalties (thesis 4.3.2, 5.3)."""

    name: Literal["vanilla", "lsgan", "wgan", "relativistic"] = Field(
        default="vanilla", description="`vanilla` is non-saturating"
    )
    r1: float = Field(default=0.1, ge=0, description="weight of half the squared gradient per logit on real pictures")
    r2: float = Field(default=0.0, ge=0, description="the same on fakes")
    gradient_penalty: float = Field(default=0.0, ge=0, description="WGAN-GP's lambda")
    penalty_every: int = Field(
        default=8, ge=1, description="steps between penalties; the weight of each is multiplied by this number"
    )
    critic_steps: int = Field(
        default=1, ge=1, description="updates of the discriminator for each update of the generator"
    )


class OptimizerConfig(StrictModel):
    """Adam for both networks, and the generator's average."""

    generator_rate: float = Field(default=2e-4, gt=0, description="learning rate")
    discriminator_rate: float = Field(default=2e-4, gt=0, description="learning rate")
    beta1: float = Field(default=0.5, ge=0, lt=1, description="decay of the mean of gradients")
    beta2: float = Field(default=0.99, ge=0, lt=1, description="decay of the mean of their squares")
    ema_images: float = Field(
        default=4000.0,
        ge=0,
        description="half-life, in images, of the averaged generator that is scored and kept; 0: no average",
    )


class ScenesConfig(StrictModel):
    """The scenes that fakes are rendered in: those of the exemplars, perturbed (thesis 5.1, 5.2)."""

    camera_noise_degrees: float = Field(
        default=0.0, ge=0, description="greatest error of azimuth and elevation, uniformly distributed, either way"
    )
    camera: CameraDistribution | None = Field(
        default=None, description="each camera is drawn from this, instead of the exemplar's"
    )
    environment: Literal["same", "redrawn"] | EnvironmentSource = Field(
        default="same", description="`redrawn`: from the data set's own light; or from another source"
    )
    pool: int = Field(
        default=1, ge=0, description="perturbed scenes stored for each exemplar; 0: a new one at every visit"
    )
    import_errors: bool = Field(
        default=True,
        description="whether fakes get errors like those that importing pictures made (`bootstrap` of the manifest); "
        "only where pictures are compared by their reflectance, in the exemplars' cameras",
    )

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
        "discriminator": {"gbuffer": False, "norm": "none", "augment": False, "compares": "radiance"},
        "generator": {"norm": "instance", "upsampling": "strided"},
        "optimizer": {"beta1": 0.5, "beta2": 0.999, "ema_images": 0.0},
    },
}
"""Defaults of each recipe, for keys that the configuration leaves out."""

_ONLINE: dict[str, Any] = {"discriminator": {"gbuffer": False}}
"""Defaults of `rendering: online`, where a G-buffer costs three more pictures of each fake in another camera."""


class TrainConfig(StrictModel):
    """A whole training run. Keys that are left out have the defaults of the recipe and the rendering (`RECIPES`)."""

    dataset: str = Field(description="the data set's folder, relative to this file")
    recipe: Literal["default", "thesis"] = Field(
        default="default",
        description="the defaults of all other keys: `default` is this page's, `thesis` is WGAN-GP with batch 1 and "
        "the thesis's networks",
    )
    seed: int = Field(default=0, ge=0, lt=2**63, description="seed of weights, batches and perturbations")
    steps: int = Field(default=20000, ge=1, description="updates of the generator")
    minutes: float | None = Field(default=None, gt=0, description="stops earlier, after this training time")
    batch_size: int = Field(default=16, ge=1, description="exemplars in a step, over all devices")
    init: str | None = Field(
        default=None,
        description="the name of a [shipped model](commands.md#shipped-models), or the folder of a run, relative to "
        "this file: training starts from its generator instead of random weights; `generator` may be left out then",
    )
    refines: str | None = Field(
        default=None,
        description="likewise a model that paints whole maps: the generator refines its layers in the windows of "
        "close-ups, so that it learns the detail alone; the data set has the model's embedding, maps and conditions, "
        "and the model a texture of 512 texels, or the data set's if that is smaller",
    )
    generator: GeneratorConfig = Field(default=GeneratorConfig(), description="the network that paints layers")
    discriminator: DiscriminatorConfig = Field(
        default=DiscriminatorConfig(), description="the network that compares pictures"
    )
    loss: LossConfig = Field(default=LossConfig(), description="what both minimise")
    optimizer: OptimizerConfig = Field(default=OptimizerConfig(), description="Adam, for both")
    scenes: ScenesConfig = Field(default=ScenesConfig(), description="the scenes that fakes are rendered in")
    renderer: PluginField = Field(default=PluginChoice(name="auto"), description="as in `dataset.yaml`")
    rendering: Literal["stored", "online"] = Field(
        default="stored",
        description="`stored`: what does not depend on the layer is traced once and stored, which is fast: light "
        "transport of base colour, and light of whole materials if the data set has `maps` "
        "([more](commands.md#whole-materials)); `online`: online rendering at every step, with any renderer",
    )
    spp: int = Field(
        default=64, ge=1, le=MOST_SAMPLES, description="samples per pixel of the fakes; best equal to the data set's"
    )
    hits: int = Field(
        default=64,
        ge=1,
        description="only where light of whole materials is stored: the most samples kept in each pixel, 20 bytes "
        "each; fakes have the exemplars' noise if it is at least `spp`",
    )
    clean_spp: int | None = Field(
        default=None,
        ge=1,
        le=MOST_SAMPLES,
        description="samples per pixel of a clean picture of each scene, without the layer. A fake is multiplied by "
        "the ratio of that to a clean picture by its own samples, which takes away the noise that both share: for "
        "photographs, and exemplars of as many samples; only where light of whole materials is stored; `null`: fakes "
        "keep their noise",
    )
    spp_grad: int | None = Field(
        default=None,
        ge=1,
        description="samples per pixel of the gradient, only with `rendering: online`; `null`: the picture's own "
        "samples",
    )
    device: Device = Field(default="auto", description="`auto`: a GPU if there is one")
    devices: int = Field(default=1, ge=1, description="processes, one for each GPU; to be left out under torchrun")
    precision: Literal["auto", "32-true", "bf16-mixed"] = Field(
        default="auto", description="`auto` is `bf16-mixed` on a GPU"
    )
    score_every: int = Field(default=500, ge=1, description="steps between scores on `validation`")
    save_every: int = Field(default=1000, ge=1, description="steps between checkpoints; the latest two are kept")

    @model_validator(mode="after")
    def _filled(self) -> TrainConfig:
        for defaults in (_ONLINE if self.rendering == "online" else {}, RECIPES[self.recipe]):
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
        if self.rendering != "stored" and self.discriminator.compares == "reflectance":
            raise ValueError("discriminator.compares: reflectance needs rendering: stored, which knows the light")
        if self.spp_grad is not None and self.rendering == "stored":
            raise ValueError(
                "spp_grad needs rendering: online; stored light has a gradient on the picture's own samples"
            )
        if self.init is not None and self.refines is not None:
            raise ValueError("init starts from a model, and refines from another's layers: name one of them")
        if self.batch_size % self.devices:
            raise ValueError(f"batch_size {self.batch_size} cannot be shared out among {self.devices} devices evenly")
        if self.loss.gradient_penalty and self.discriminator.norm == "instance":
            raise ValueError("loss.gradient_penalty needs discriminator.norm none or group or pixel")
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


def resolved(config: TrainConfig, spp: int, maps: Collection[str] = (), *, imported: bool = False) -> TrainConfig:
    """The configuration with `discriminator.compares` decided.

    `auto` means radiance where fakes have their exemplars' scenes and samples per pixel, since then only texture
    tells them apart, and where pictures cannot be divided by their light: with `rendering: online`, or if layers paint
    further maps. Elsewhere, and for imported pictures, whose scenes are estimates, it means reflectance.

    Args:
        spp: samples per pixel of the exemplars.
        maps: maps that layers paint besides base_color.
        imported: whether the exemplars are.
    """
    discriminator = config.discriminator
    if discriminator.compares != "auto":
        return config
    indivisible = bool(maps) or config.rendering != "stored"
    plain = indivisible or (config.scenes.matched and config.spp == spp and not imported)
    compares = "radiance" if plain else "reflectance"
    return config.model_copy(update={"discriminator": discriminator.model_copy(update={"compares": compares})})
