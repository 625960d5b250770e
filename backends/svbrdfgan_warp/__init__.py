"""A renderer of direct light on CPU and GPU in NVIDIA Warp, with its own ray tracing and hand-written adjoints."""

from svbrdfgan_warp.renderer import WarpRenderer

__all__ = ["WarpRenderer"]
