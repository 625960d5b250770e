"""Dr.Jit and Mitsuba, imported with a good LLVM where there is one, and arrays that they share with torch.

Arrays keep their memory, on the CPU and on the GPU, wherever type and layout allow.
"""

from __future__ import annotations

import importlib
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from svbrdfgan_mitsuba import llvm

# All other modules take both from here: the first import of drjit decides which LLVM it loads.
dr: Any = llvm.import_drjit()
mitsuba: Any = importlib.import_module("mitsuba")


def floats(mi: Any, tensor: Float[Tensor, "*shape"], device: torch.device) -> Any:
    """The values as a flat Dr.Jit array. Only a tensor of other type, layout or device is copied."""
    return mi.Float(tensor.detach().to(device, torch.float32).contiguous().reshape(-1))


def unsigned(mi: Any, tensor: Int[Tensor, "*shape"], device: torch.device) -> Any:
    """Integers below 2^32 as a flat Dr.Jit array, given as such or as int32 of the same bits."""
    bits = tensor.to(device, torch.int32).contiguous().reshape(-1)
    return dr.reinterpret_array(mi.UInt32, mi.Int32(bits))  # torch has no uint32 to share memory with


def tensor(array: Any) -> Tensor:
    """A Dr.Jit array, evaluated, as a torch tensor of the same memory."""
    dr.eval(array)
    dr.sync_thread()
    result: Tensor = array.torch()
    return result


def wait_for_torch(device: torch.device) -> None:
    """Waits until torch has written what Dr.Jit will read: on a GPU each of them uses a stream of its own."""
    if device.type == "cuda":
        torch.cuda.current_stream(device).synchronize()
