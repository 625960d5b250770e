"""The mesh's own UVs as an embedding: kept bit for bit if they are one-to-one, repaired if they are not."""

from svbrdfgan_given.embedding import GivenEmbedding

__all__ = ["GivenEmbedding"]
