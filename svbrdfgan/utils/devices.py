"""Where torch computes: a GPU or the CPU, as a user names it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, TypeAlias, get_args

from svbrdfgan.errors import ConfigError
from svbrdfgan.utils.memory import allowed_bytes

if TYPE_CHECKING:
    import torch

Device: TypeAlias = Literal["auto", "cpu", "cuda"]
"""`auto` is a GPU if there is one."""
DEVICES: tuple[Device, ...] = get_args(Device)


def torch_device(device: Device) -> torch.device:
    """The device of that name.

    Raises:
        ConfigError: `device` is "cuda", and torch finds no GPU.
    """
    import torch

    found = torch.cuda.is_available()
    if device == "cuda" and not found:
        raise ConfigError("device: torch sees no CUDA GPU here; use auto or cpu, or install torch's build for CUDA.")
    return torch.device("cuda" if device != "cpu" and found else "cpu")


def device_bytes(device: torch.device) -> int:
    """The bytes of a GPU's memory, or of main memory that may be taken."""
    import torch

    return int(torch.cuda.get_device_properties(device).total_memory) if device.type == "cuda" else allowed_bytes()
