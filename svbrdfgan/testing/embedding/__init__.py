"""The conformance kit of UV embeddings.

class TestMine(UVEmbeddingTests):
    name = "mine"
"""

from svbrdfgan.testing.embedding.contract import ContractTests
from svbrdfgan.testing.embedding.mapping import MappingTests
from svbrdfgan.testing.embedding.robustness import RobustnessTests
from svbrdfgan.testing.embedding.surface import SurfaceTests
from svbrdfgan.testing.embedding.use import UseTests

__all__ = ["UVEmbeddingTests"]


class UVEmbeddingTests(ContractTests, SurfaceTests, MappingTests, RobustnessTests, UseTests):
    """Tests for every UV embedding; see `svbrdfgan.protocols`, `svbrdfgan.types` and `docs/conventions.md`."""
