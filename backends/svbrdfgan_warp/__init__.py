"""A renderer of direct light on CPU and GPU, written in NVIDIA Warp: traces rays, and writes its adjoint by hand."""

from svbrdfgan_warp.renderer import WarpRenderer

__all__ = ["WarpRenderer"]
