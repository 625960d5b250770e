"""Both embeddings pass the kit that third parties run on theirs."""

import pytest
from svbrdfgan_igl import LscmEmbedding, StretchEmbedding

from svbrdfgan.protocols import UVEmbedding
from svbrdfgan.testing import UVEmbeddingTests


class TestCoarseStretch(UVEmbeddingTests):
    """The kit whole, with the coarsest wrap there is."""

    def make_embedding(self) -> UVEmbedding:
        return StretchEmbedding(cells=16, resolution=64)


@pytest.mark.slow
class TestStretch(UVEmbeddingTests):
    def make_embedding(self) -> UVEmbedding:
        return StretchEmbedding()


@pytest.mark.slow
class TestLscm(UVEmbeddingTests):
    def make_embedding(self) -> UVEmbedding:
        return LscmEmbedding()
