"""Mitsuba's classes for one device, with no variant set.

Mitsuba's manual sets one variant for the whole process. Changing it takes 55 ms each way, because Mitsuba reloads its
Python integrators, which also replaces the caller's classes; and once set, it cannot be unset. But each variant is also
a module that can be imported by itself. So `mitsuba.variant()` stays as the caller left it, None included. The parts of
Mitsuba that are written in Python read the variant that is set, and are not used here; `instantiate` and `assign`
stand in for `load_dict` and `traverse`.
"""

from __future__ import annotations

import importlib
import re
from collections.abc import Mapping
from typing import Any

import torch

from svbrdfgan.errors import ConfigError, PluginError
from svbrdfgan_mitsuba import llvm
from svbrdfgan_mitsuba.interop import dr, mitsuba

_NAMES = {"cpu": "llvm_ad_rgb", "cuda": "cuda_ad_rgb"}


def choose_device(name: str) -> torch.device:
    """The torch device that `name` ("auto", "cpu", "cuda" or "cuda:0") means.

    "auto" prefers CUDA where both torch and Dr.Jit can use it. Dr.Jit works on the first GPU only.

    Raises:
        ConfigError: another name, or a device that torch does not find.
        PluginError: no usable LLVM for the CPU, or a GPU that Dr.Jit cannot use.
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
    """The module with Mitsuba's classes for the device; only the first call takes time."""
    return importlib.import_module(f"mitsuba.{_NAMES[device.type]}")


def instantiate(device: torch.device, description: dict[str, Any]) -> Any:
    """The object that a dictionary describes: `mitsuba.load_dict`, for this device's variant."""
    parser = mitsuba.parser
    config = parser.ParserConfig(_NAMES[device.type])
    state = parser.parse_dict(config, description)
    parser.transform_all(config, state)
    made = parser.instantiate(config, state)
    return made[0] if isinstance(made, list) else made


def assign(mi: Any, thing: Any, values: Mapping[str, Any]) -> None:
    """Sets parameters of a Mitsuba object. The object is not notified: the caller must update what depends on them."""
    found: dict[str, Any] = {}

    class Locations(mi.TraversalCallback):
        """Collects where the object stores its parameters."""

        def put(self, name: str, value: Any, flags: int, kind: Any = None) -> None:
            found[name] = (value, kind)

        put_value = put_object = put

    thing.traverse(Locations())
    for name, value in values.items():
        mi.set_property(*found[name], value)
