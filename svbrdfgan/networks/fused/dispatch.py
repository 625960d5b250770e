"""What stands between two convolutions, as one operation, by the fastest way that works.

On CUDA with Triton it is a few kernels that read and write channels-last memory, and write the padded values alone.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.networks.fused.reference import Features, Prologue, plain
from svbrdfgan.utils.triton_works import triton_works

_HANDLED = (torch.float32, torch.bfloat16, torch.float16)


def prologue(
    x: Float[Tensor, "batch channels rows cols"],
    how: Prologue,
    residual: Float[Tensor, "batch channels rows cols"] | None = None,
) -> Features:
    """Differentiable once where kernels work; the result is then of autocast's precision and not to be changed."""
    if x.device.type != "cuda" or not _fits(x, how) or not triton_works(x.device):
        return plain(x, how, residual)
    from svbrdfgan.networks.fused.autograd import fused

    return fused(x, how, residual)


def _fits(x: Tensor, how: Prologue) -> bool:
    """Whether kernels do it: in at most single precision, with borders whose mirror images lie apart."""
    return x.dtype in _HANDLED and min(x.shape[-2:]) * how.upsample > 2 * how.pad + 1
