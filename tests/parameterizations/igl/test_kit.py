"""Both embeddings pass the kit that third parties run on theirs."""

from svbrdfgan_igl import LscmEmbedding, StretchEmbedding

from svbrdfgan.protocols import UVEmbedding
from svbrdfgan.testing import UVEmbeddingTests


class TestStretch(UVEmbeddingTests):
    def make_embedding(self) -> UVEmbedding:
        return StretchEmbedding(cells=48)


class TestLscm(UVEmbeddingTests):
    def make_embedding(self) -> UVEmbedding:
        return LscmEmbedding(cells=48)
