"""UV embeddings of the outer surface through libigl: `lscm` keeps angles, `stretch` has the least L2 stretch."""

from svbrdfgan_igl.embedding import LscmEmbedding, StretchEmbedding

__all__ = ["LscmEmbedding", "StretchEmbedding"]
