"""Arrays between torch and Dr.Jit: the same memory, on the CPU and on the GPU, wherever type and layout allow."""

from __future__ import annotations

from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from svbrdfgan_mitsuba.jit import dr


def floats(mi: Any, tensor: Float[Tensor, "*shape"], device: torch.device) -> Any:
    """The values in a row, as a Dr.Jit array. A copy is made only of what is not float32, contiguous and there."""
    return mi.Float(tensor.detach().to(device, torch.float32).contiguous().reshape(-1))


def unsigned(mi: Any, tensor: Int[Tensor, "*shape"], device: torch.device) -> Any:
    """Whole numbers below 2^32, given as such or as int32 of the same bits."""
    bits = tensor.to(device, torch.int32).contiguous().reshape(-1)
    return dr.reinterpret_array(mi.UInt32, mi.Int32(bits))


def tensor(array: Any) -> Tensor:
    """A Dr.Jit array, evaluated, as torch tensor of the same memory."""
    dr.eval(array)
    dr.sync_thread()
    result: Tensor = array.torch()
    return result


def wait_for_torch(device: torch.device) -> None:
    """Until torch has written what Dr.Jit will read: on a GPU each works in a stream of its own."""
    if device.type == "cuda":
        torch.cuda.current_stream(device).synchronize()
