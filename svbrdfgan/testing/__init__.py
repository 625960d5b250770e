"""Conformance kits: what every renderer and every UV embedding must do, as tests that anybody can run on theirs.

In a test file that pytest collects:

    from svbrdfgan.testing import RendererTests

    class TestMine(RendererTests):
        name = "mine"  # of the entry point

The same tests as a table: `svbrdfgan check mine`.
"""

from svbrdfgan.testing.embedding import UVEmbeddingTests
from svbrdfgan.testing.kit import Outcome, run_kit
from svbrdfgan.testing.renderer import RendererTests

__all__ = ["Outcome", "RendererTests", "UVEmbeddingTests", "run_kit"]
