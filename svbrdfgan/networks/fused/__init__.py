"""Norm, modulation, activation or skip connection, upsampling and padding between two convolutions, as one operation.

On CUDA with Triton it is a few kernels over channels-last memory; elsewhere it is torch's own operations.
`benchmarks/fused_norm.py` compares both with `torch.compile`.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.networks.fused.reference import Affine, Features, NormActPad, norm_act_pad_reference
from svbrdfgan.utils.triton_works import triton_works

__all__ = ["Affine", "Features", "NormActPad", "norm_act_pad"]

_KERNEL_DTYPES = (torch.float32, torch.bfloat16, torch.float16)


def norm_act_pad(
    x: Float[Tensor, "batch channels rows cols"],
    spec: NormActPad,
    residual: Float[Tensor, "batch channels rows cols"] | None = None,
    affine: Affine | None = None,
) -> Features:
    """The result of `spec` for these inputs, by Triton kernels where they apply, else by the reference.

    The kernels' results have autocast's precision, must not be changed in place, and differentiate once only.
    """
    if x.device.type != "cuda" or not _kernels_apply(x, spec) or not triton_works(x.device):
        return norm_act_pad_reference(x, spec, residual, affine)
    from svbrdfgan.networks.fused.autograd import norm_act_pad_triton

    return norm_act_pad_triton(x, spec, residual, affine)


def _kernels_apply(x: Tensor, spec: NormActPad) -> bool:
    # a texel has at most one mirror image along each axis only if the two borders reflect different texels
    borders_lie_apart = min(x.shape[-2:]) * spec.upsample > 2 * spec.pad + 1
    return x.dtype in _KERNEL_DTYPES and borders_lie_apart
