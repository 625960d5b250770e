"""What may differ between exemplars and fakes besides the texture, and what helps against each."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Literal, get_args

from svbrdfgan.data.config import DatasetConfig
from svbrdfgan.protocols import Renderer
from svbrdfgan.training.config import ScenesConfig, TrainConfig

Nuisance = Literal["pose", "light", "noise", "renderer"]
NUISANCES: tuple[Nuisance, ...] = get_args(Nuisance)

REMEDIES: Mapping[Nuisance, str] = MappingProxyType(
    {
        "pose": "Let the discriminator see reflectance (discriminator.sees), carried to the exemplar's camera; or draw "
        "the fakes' cameras from the distribution of the exemplars' own (scenes.camera).",
        "light": "Let the discriminator see reflectance (discriminator.sees), where the exemplars' light is known; or "
        "give the fakes lights that cover theirs (scenes.environment).",
        "noise": "Where the discriminator sees radiance, train with the exemplars' own samples per pixel (spp), or let "
        "it see reflectance; there, exemplars of more samples have less noise, which hardly hinders learning.",
        "renderer": "Train through the renderer that made the exemplars, with as many bounces; where that cannot be, "
        "denoise or blur both sides alike.",
    }
)
"""The best known, one sentence each."""


def differences(
    config: TrainConfig, dataset: DatasetConfig, made_with: Renderer[Any], trained_with: Renderer[Any]
) -> dict[Nuisance, str]:
    """The nuisances that differ under this configuration, and how, in words.

    Args:
        made_with: renders the exemplars.
        trained_with: renders the fakes.
    """
    found: dict[Nuisance, str] = {"pose": _pose(config.scenes), "light": _light(config.scenes)}
    if config.discriminator.sees == "reflectance":
        found["noise"] = f"{dataset.spp} samples per pixel in exemplars, no noise in fakes"
    elif dataset.spp != config.spp:
        found["noise"] = f"{dataset.spp} samples per pixel in exemplars, {config.spp} in fakes"
    if (type(made_with), made_with.capabilities) != (type(trained_with), trained_with.capabilities):
        found["renderer"] = f"{_title(made_with)} for exemplars, {_title(trained_with)} for fakes"
    return {name: how for name, how in found.items() if how}


def scenes_with(scenes: ScenesConfig, differing: frozenset[Nuisance]) -> ScenesConfig:
    """The same perturbation of these nuisances alone."""
    matched = ScenesConfig()
    update: dict[str, Any] = {}
    if "pose" not in differing:
        update |= {"camera": matched.camera, "camera_noise_degrees": matched.camera_noise_degrees}
    if "light" not in differing:
        update["environment"] = matched.environment
    return scenes.model_copy(update=update)


def _pose(scenes: ScenesConfig) -> str:
    drawn = "fakes' cameras are drawn anew" if scenes.camera is not None else ""
    off = f"fakes' cameras are off by up to {scenes.camera_noise_degrees:g} degrees"
    return drawn or (off if scenes.camera_noise_degrees else "")


def _light(scenes: ScenesConfig) -> str:
    told = {"same": "", "redrawn": "fakes are lit anew, from the exemplars' own distribution"}
    if isinstance(scenes.environment, str):
        return told[scenes.environment]
    return "fakes are lit from another source"


def _title(renderer: Renderer[Any]) -> str:
    bounces = renderer.capabilities.max_bounces
    return f"{type(renderer).__name__} with {bounces} bounce{'s' if bounces > 1 else ''}"
