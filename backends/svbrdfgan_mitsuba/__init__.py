"""A renderer on Mitsuba 3: Embree on the CPU, OptiX on the GPU, kernels and derivatives by Dr.Jit."""

from svbrdfgan_mitsuba.renderer import MitsubaRenderer

__all__ = ["MitsubaRenderer"]
