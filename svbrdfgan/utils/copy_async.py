"""Copies from the CPU to a GPU that nothing waits for."""

from __future__ import annotations

import torch
from torch import Tensor


def copy_async(tensor: Tensor, device: torch.device | str) -> Tensor:
    """The tensor on a device. A copy from the CPU to CUDA is queued on the current stream; the caller goes on."""
    device = torch.device(device)
    if device.type == "cuda" and tensor.device.type == "cpu":
        # from pageable memory the copy would be synchronous, non_blocking or not
        return tensor.pin_memory().to(device, non_blocking=True)
    return tensor.to(device)
