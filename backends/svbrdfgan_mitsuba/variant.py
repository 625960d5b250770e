"""Mitsuba's classes for one device, with no variant set.

Mitsuba's manual has one variant set for the whole process. Changing it costs 55 ms each way, because Mitsuba's Python
integrators are reloaded, which also replaces the caller's; and once set, it cannot be unset. But every variant is a
module of its own that can be imported as it is. So `mitsuba.variant()` stays what the caller made it, None included,
and nothing is switched. What Mitsuba writes in Python looks at the variant that is set, and is not used; `load_dict`
and `traverse` have their like here.
"""

from __future__ import annotations

import importlib
import re
from collections.abc import Mapping
from typing import Any

import torch

from svbrdfgan.errors import ConfigError, PluginError
from svbrdfgan_mitsuba import llvm
from svbrdfgan_mitsuba.jit import dr, mitsuba

_NAMES = {"cpu": "llvm_ad_rgb", "cuda": "cuda_ad_rgb"}


def choose(name: str) -> torch.device:
    """The torch device that `name` means: "auto", "cpu", "cuda" or "cuda:0"; "auto" prefers CUDA.

    Dr.Jit works on the first GPU, where torch and Dr.Jit both can.

    Raises:
        ConfigError: another name, or torch finds no such device.
        PluginError: there is no LLVM for the CPU, or Dr.Jit cannot use the GPU that was asked for.
    """
    if not re.fullmatch(r"auto|cpu|cuda(:0)?", name):
        raise ConfigError(f"mitsuba renderer: device is {name!r}; wanted 'auto', 'cpu', 'cuda' or 'cuda:0'.")
    has_cuda = torch.cuda.is_available()
    works = has_cuda and dr.has_backend(dr.JitBackend.CUDA)
    if name == "cpu" or (name == "auto" and not works):
        llvm.require()
        return torch.device("cpu")
    if not has_cuda:
        raise ConfigError(f"mitsuba renderer: device is {name!r}, but torch finds no CUDA device; choose 'cpu'.")
    if not works:
        raise PluginError(
            f"mitsuba renderer: device is {name!r}, but drjit cannot use CUDA here, for lack of NVIDIA's driver; "
            "choose 'cpu'."
        )
    return torch.device("cuda", 0)


def load(device: torch.device) -> Any:
    """The module with Mitsuba's classes for the device. Takes no time but the first."""
    return importlib.import_module(f"mitsuba.{_NAMES[device.type]}")


def instantiate(device: torch.device, description: dict[str, Any]) -> Any:
    """The object that a dictionary describes, as `mitsuba.load_dict` does for the variant that is set."""
    parser = mitsuba.parser
    config = parser.ParserConfig(_NAMES[device.type])
    state = parser.parse_dict(config, description)
    parser.transform_all(config, state)
    made = parser.instantiate(config, state)
    return made[0] if isinstance(made, list) else made


def assign(mi: Any, thing: Any, values: Mapping[str, Any]) -> None:
    """Sets parameters of one of Mitsuba's objects, which is not told: see that it notices."""
    found: dict[str, Any] = {}

    class Places(mi.TraversalCallback):
        """Notes where the object keeps its parameters."""

        def put(self, name: str, value: Any, flags: int, kind: Any = None) -> None:
            found[name] = (value, kind)

        put_value = put_object = put

    thing.traverse(Places())
    for name, value in values.items():
        mi.set_property(*found[name], value)
