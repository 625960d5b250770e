"""Plugin selection: the renderer that a configuration names, or the best one that works here for `auto`."""

from __future__ import annotations

import logging
from collections.abc import Collection, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING

from svbrdfgan.config.choices import PluginChoice
from svbrdfgan.errors import ConfigError, PluginError
from svbrdfgan.plugins.probe import Probe, probe
from svbrdfgan.plugins.registry import RENDERERS, Plugin, list_plugins, load_bouncing
from svbrdfgan.utils.devices import Device

if TYPE_CHECKING:
    import torch

    from svbrdfgan.rendering.checked_renderer import CheckedRenderer

RANKING: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {"cuda": ("warp", "mitsuba", "numpy"), "cpu": ("mitsuba", "warp", "numpy")}
)
"""Renderers by device, fastest first; others follow in alphabetical order.

Measured on two CPU cores, for 64x64 pixels and 16 samples of a vehicle of 17,768 faces: `warp` takes 6 times as long as
`mitsuba` for a picture, 8 times for its gradient and 1.3 times for its transport; `numpy` takes twenty times as long as
`warp`. Measured on an H200, for the standard scene: `mitsuba` takes 1.5 times as long as `warp`."""

log = logging.getLogger(__name__)


def resolve_renderer(
    choice: PluginChoice,
    device: torch.device | None = None,
    maps: Collection[str] = (),
    *,
    differentiable: bool = False,
    deferred: bool = False,
    bounces: int | None = None,
) -> tuple[CheckedRenderer, PluginChoice]:
    """The renderer that a configuration names, and the choice as it is recorded in files.

    For `auto` the recorded choice names the renderer but not the device, so that another machine can render the same.

    Args:
        device: the device of `auto`; None leaves that open, too.
        maps: maps that layers paint besides base_color.
        differentiable: whether the renderer must have gradients for them.
        deferred: whether it must be a `DeferredRenderer`; of a named renderer, the caller finds out.
        bounces: scattering events that it follows if it can; None leaves them to the choice.

    Raises:
        ConfigError: the named renderer cannot render or differentiate these maps.
        PluginError: the named renderer is unknown or does not work here; for `auto`, no renderer works.
    """
    if choice.name == "auto":
        kind: Device = "auto"
        if device is not None:
            kind = "cuda" if device.type == "cuda" else "cpu"
        best = select_renderer(kind, maps, differentiable=differentiable, deferred=deferred)
        return load_bouncing(best.name, best.options, bounces), PluginChoice(name=best.name)
    renderer = load_bouncing(choice.name, choice.options, bounces)
    able = renderer.capabilities.maps & renderer.capabilities.differentiable
    lacking = [name for name in maps if name not in (able if differentiable else renderer.capabilities.maps)]
    if lacking:
        raise ConfigError(
            f"{renderer.name} renderer cannot {'learn' if differentiable else 'render'} {', '.join(lacking)}, which "
            "the data set's layers paint: choose a renderer that can (`svbrdfgan backends` shows what each can do)."
        )
    return renderer, choice


def select_renderer(
    device: Device = "auto",
    maps: Collection[str] = (),
    *,
    differentiable: bool = False,
    deferred: bool = False,
) -> PluginChoice:
    """The first renderer in `RANKING` that works on the device, and its options. For "auto", GPUs come before the CPU.

    Each candidate is tried in its own process, until one works.

    Args:
        maps: maps that it must read.
        differentiable: whether it must have gradients with respect to these maps.
        deferred: whether it must be a `DeferredRenderer`.

    Raises:
        PluginError: none works; the message says why for each.
    """
    reasons = []
    for wanted in _devices() if device == "auto" else (device,):
        for plugin in _ranked(list_plugins(RENDERERS), wanted):
            outcome = probe(plugin, wanted)
            reason = outcome.reason or _lack(outcome, maps, differentiable, deferred)
            if reason is None:
                log.info("renderer: %s on %s", plugin.title, wanted)
                return PluginChoice(name=plugin.name, options=dict(outcome.options))
            log.info("renderer %r is not used on %s: %s", plugin.name, wanted, reason)
            reasons.append(f"  {plugin.name} on {wanted}: {reason}")
    none = "" if reasons else " none is installed."
    raise PluginError(f"no installed renderer works on {device!r}:{none}", *reasons)


def _lack(outcome: Probe, maps: Collection[str], differentiable: bool, deferred: bool) -> str | None:
    """A sentence on what the renderer lacks of what is asked; None if it lacks nothing."""
    able = outcome.capabilities or {}
    for ability, needed in (("maps", True), ("differentiable", differentiable)):
        lacking = sorted(set(maps) - set(able[ability])) if needed else []
        if lacking:
            return f"{', '.join(lacking)} {'is' if len(lacking) == 1 else 'are'} not in its {ability}."
    if deferred and not able.get("deferred", False):
        return "it stores no light."
    return None


def _devices() -> tuple[str, ...]:
    import torch

    return ("cuda", "cpu") if torch.cuda.is_available() else ("cpu",)


def _ranked(plugins: tuple[Plugin, ...], device: str) -> list[Plugin]:
    rank = {name: place for place, name in enumerate(RANKING[device])}
    return sorted(plugins, key=lambda plugin: (rank.get(plugin.name, len(rank)), plugin.name))
