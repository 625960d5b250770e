"""The UV embedding that a mesh brings along: kept bit for bit where it is one-to-one, repaired where it is not."""

from svbrdfgan_given.embedding import GivenEmbedding

__all__ = ["GivenEmbedding"]
