"""The reference renderer: a path tracer in NumPy, in float64, written to be read."""

from svbrdfgan_numpy.renderer import NumpyRenderer

__all__ = ["NumpyRenderer"]
