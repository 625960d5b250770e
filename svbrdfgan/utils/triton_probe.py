"""A minimal Triton kernel. It is a module of its own since importing it needs Triton, which is optional."""
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import torch
import triton  # type: ignore[import-not-found, import-untyped, unused-ignore]
import triton.language as tl  # type: ignore[import-not-found, import-untyped, unused-ignore]


@triton.jit
def _store_one(address):
    tl.store(address, 1)


def require_working(device: torch.device) -> None:
    """Compiles and runs the kernel; raises any exception if that fails, such as where there is no C compiler."""
    with torch.cuda.device(device):
        _store_one[(1,)](torch.zeros(1, dtype=torch.int32, device=device))
