"""`renderer: auto`: the best renderer that works on this machine."""

from __future__ import annotations

import logging
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

from svbrdfgan.errors import PluginError
from svbrdfgan.plugins import RENDERERS, Plugin, list_plugins
from svbrdfgan.plugins.probe import Probe, probe

RANKING: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {"cuda": ("warp", "mitsuba", "numpy"), "cpu": ("mitsuba", "warp", "numpy")}
)
"""Fastest first. Measured for 64x64 pixels and 16 samples of a vehicle of 17,768 faces on two CPU cores, in one run:
`warp` takes 6 times as long as `mitsuba` for a picture, 8 times for its gradient and 1.3 times for its transport, and
`numpy` some twenty times as long as `warp`. On an H200, for the standard scene, `mitsuba` takes 1.5 times as long as
`warp`. Names not listed come last, in alphabetical order."""

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Choice:
    """What to give to `load_renderer`."""

    name: str
    options: Mapping[str, object]


def choose_renderer(
    device: Literal["auto", "cpu", "cuda"] = "auto", maps: Collection[str] = (), *, differentiable: bool = False
) -> Choice:
    """The first in `RANKING` that works on the device; "auto" is a GPU where some renderer works on one, else the CPU.

    Each candidate is tried in a process of its own until one works.

    Args:
        maps: those that it must read.
        differentiable: whether it must have gradients for them, too.

    Raises:
        PluginError: none works, and why.
    """
    reasons = []
    for wanted in _devices() if device == "auto" else (device,):
        for plugin in _ranked(list_plugins(RENDERERS), wanted):
            outcome = probe(plugin, wanted)
            reason = outcome.reason or _lack(outcome, maps, differentiable)
            if reason is None:
                log.info("renderer: %s on %s", plugin.title, wanted)
                return Choice(plugin.name, outcome.options)
            log.info("renderer %r is passed over on %s: %s", plugin.name, wanted, reason)
            reasons.append(f"\n  {plugin.name} on {wanted}: {reason}")
    raise PluginError(f"no installed renderer works on {device!r}:{''.join(reasons) or ' none is installed.'}")


def _lack(outcome: Probe, maps: Collection[str], differentiable: bool) -> str | None:
    """What a renderer that works cannot do of what is asked."""
    able = outcome.capabilities or {}
    for ability, needed in (("maps", True), ("differentiable", differentiable)):
        lacking = sorted(set(maps) - set(able[ability])) if needed else []
        if lacking:
            return f"{', '.join(lacking)} {'is' if len(lacking) == 1 else 'are'} not in its {ability}."
    return None


def _devices() -> tuple[str, ...]:
    import torch

    return ("cuda", "cpu") if torch.cuda.is_available() else ("cpu",)


def _ranked(plugins: tuple[Plugin, ...], device: str) -> list[Plugin]:
    rank = {name: place for place, name in enumerate(RANKING[device])}
    return sorted(plugins, key=lambda plugin: (rank.get(plugin.name, len(rank)), plugin.name))
