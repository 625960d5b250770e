"""The smallest kernel in Triton."""
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import torch
import triton  # type: ignore[import-not-found, import-untyped, unused-ignore]
import triton.language as tl  # type: ignore[import-not-found, import-untyped, unused-ignore]


@triton.jit
def _mark(place):
    tl.store(place, 1)


def require_working(device: torch.device) -> None:
    """Compiles and runs a kernel of one store; raises whatever goes wrong, such as the lack of a C compiler."""
    with torch.cuda.device(device):
        _mark[(1,)](torch.zeros(1, dtype=torch.int32, device=device))
