"""Whether Triton works, for those who would import kernels that are written in it."""

from __future__ import annotations

import logging
from functools import cache

import torch

log = logging.getLogger(__name__)


@cache
def triton_works(device: torch.device) -> bool:
    """On this device; if not, says so once. Triton comes with torch for CUDA on Linux, and needs a C compiler."""
    try:
        from svbrdfgan.utils.triton_probe import require_working

        require_working(device)
    except Exception as error:  # whatever keeps Triton from compiling, plain torch does the same
        log.warning("Triton does not work on %s, so plain torch does its work there, slower: %s", device, error)
        return False
    return True
