"""Whether Triton kernels can be used."""

from __future__ import annotations

import logging
from functools import cache

import torch

log = logging.getLogger(__name__)


@cache
def triton_works(device: torch.device) -> bool:
    """Whether Triton compiles and runs on this device; logs a warning once if not.

    Triton comes with torch for CUDA on Linux, and needs a C compiler.
    """
    try:
        from svbrdfgan.utils.triton_probe import require_working

        require_working(device)
    except Exception as error:  # of any kind: torch's own operations give the same results
        log.warning("Triton does not work on %s; torch's own operations replace it, slower: %s", device, error)
        return False
    return True
