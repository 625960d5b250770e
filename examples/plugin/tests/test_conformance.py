"""Both plugins, as installed, do what svbrdfgan asks of every renderer and every embedding."""

from svbrdfgan.testing import RendererTests, UVEmbeddingTests


class TestGrid(RendererTests):
    name = "grid"


class TestCube(UVEmbeddingTests):
    name = "cube"
