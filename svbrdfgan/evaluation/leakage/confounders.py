"""Confounders: what may differ between exemplars and fakes besides the texture, and a remedy for each."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Literal, get_args

from svbrdfgan.rendering.checked_renderer import CheckedRenderer
from svbrdfgan.training.config import ScenesConfig
from svbrdfgan.training.resolve import ResolvedRun

Confounder = Literal["pose", "light", "noise", "renderer"]
CONFOUNDERS: tuple[Confounder, ...] = get_args(Confounder)

REMEDIES: Mapping[Confounder, str] = MappingProxyType(
    {
        "pose": "Let the discriminator see reflectance (discriminator.compares), carried to the exemplar's camera, "
        "where layers paint base_color alone; or draw the fakes' cameras from the distribution of the exemplars' own "
        "(scenes.camera).",
        "light": "Let the discriminator see reflectance (discriminator.compares), where the exemplars' light is known "
        "and layers paint base_color alone; or give the fakes lights that cover theirs (scenes.environment).",
        "noise": "Where the discriminator sees radiance, train with the exemplars' samples per pixel (spp, hits); or "
        "let it see reflectance: there, exemplars of more samples have less noise, which hardly hinders learning.",
        "renderer": "Train through the renderer that made the exemplars, with as many bounces; where that cannot be, "
        "denoise or blur both sides alike.",
    }
)
"""The best known remedy for each confounder, in one sentence."""


def find_confounders(
    run: ResolvedRun, exemplar_renderer: CheckedRenderer, renderer: CheckedRenderer
) -> dict[Confounder, str]:
    """The confounders of this run's configuration, and how the two sides differ in each, in words.

    Args:
        exemplar_renderer: renders the exemplars.
        renderer: renders the fakes.
    """
    config, exemplar_spp = run.config, run.dataset.config.spp
    found: dict[Confounder, str] = {"pose": _pose(config.scenes), "light": _light(config.scenes)}
    if config.discriminator.compares == "reflectance":
        found["noise"] = f"{exemplar_spp} samples per pixel in exemplars, no noise in fakes"
    elif exemplar_spp != run.fake_spp:
        found["noise"] = f"{exemplar_spp} samples per pixel in exemplars, {run.fake_spp} in fakes"
    if (exemplar_renderer.name, exemplar_renderer.capabilities) != (renderer.name, renderer.capabilities):
        found["renderer"] = f"{_title(exemplar_renderer)} for exemplars, {_title(renderer)} for fakes"
    return {name: how for name, how in found.items() if how}


def scenes_with(scenes: ScenesConfig, present: frozenset[Confounder]) -> ScenesConfig:
    """The same perturbation, of these confounders alone."""
    matched = ScenesConfig()
    update: dict[str, Any] = {}
    if "pose" not in present:
        update |= {"camera": matched.camera, "camera_noise_degrees": matched.camera_noise_degrees}
    if "light" not in present:
        update["environment"] = matched.environment
    return scenes.model_copy(update=update)


def _pose(scenes: ScenesConfig) -> str:
    drawn = "fakes' cameras are drawn from another distribution" if scenes.camera is not None else ""
    off = f"fakes' cameras are off by up to {scenes.camera_noise_degrees:g} degrees"
    return drawn or (off if scenes.camera_noise_degrees else "")


def _light(scenes: ScenesConfig) -> str:
    words = {"same": "", "redrawn": "fakes' lights are drawn again from the exemplars' distribution"}
    if isinstance(scenes.environment, str):
        return words[scenes.environment]
    return "fakes are lit from another source"


def _title(renderer: CheckedRenderer) -> str:
    bounces = renderer.capabilities.max_bounces
    return f"{renderer.name} with {bounces} bounce{'s' if bounces > 1 else ''}"
