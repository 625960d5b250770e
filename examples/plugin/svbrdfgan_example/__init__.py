"""A renderer and a UV embedding for svbrdfgan."""

from svbrdfgan_example.cube import CubeEmbedding
from svbrdfgan_example.renderer import GridRenderer

__all__ = ["CubeEmbedding", "GridRenderer"]
