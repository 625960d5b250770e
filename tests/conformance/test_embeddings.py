"""Every UV embedding of this repository passes the kit that third parties run on theirs."""

from svbrdfgan.testing import UVEmbeddingTests


class TestHemispherical(UVEmbeddingTests):
    name = "hemispherical"


class TestGiven(UVEmbeddingTests):
    name = "given"
