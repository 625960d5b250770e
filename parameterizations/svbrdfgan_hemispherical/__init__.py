"""The hemispherical UV embedding of the thesis (section 4.1): directions from below the middle of the vehicle."""

from svbrdfgan_hemispherical.embedding import HemisphericalEmbedding

__all__ = ["HemisphericalEmbedding"]
