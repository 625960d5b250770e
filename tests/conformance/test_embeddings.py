"""Every UV embedding of this repository passes the kit that third parties run on theirs."""

import pytest
from tiers import only, without

from svbrdfgan.plugins.registry import load_embedding
from svbrdfgan.protocols import UVEmbedding
from svbrdfgan.testing import UVEmbeddingTests

QUICK_OF_STRETCH = (
    "test_its_entry_point_finds_it",
    "test_options_have_types_and_defaults",
    "test_its_repr_is_one_line",
    "test_is_an_embedding",
    "test_capabilities_are_constant",
    "test_it_pickles",
    "test_pieces_cover_every_face_once",
    "test_one_to_one_means_no_overlap",
    "test_elevation_is_zero_where_one_to_one",
    "test_a_single_triangle",
    "test_planes",
    "test_a_needle",
)


class TestHemispherical(UVEmbeddingTests):
    name = "hemispherical"


class TestGiven(UVEmbeddingTests):
    name = "given"


class CoarseStretch(UVEmbeddingTests):
    """With the coarsest wrap there is."""

    def make_embedding(self) -> UVEmbedding:
        pytest.importorskip("igl", reason="the stretch embedding needs libigl")
        return load_embedding("stretch", {"cells": 16, "resolution": 64})


@only(*QUICK_OF_STRETCH)
class TestCoarseStretch(CoarseStretch):
    """What takes a second each, and one test of a kind of those that examine four surfaces."""


@pytest.mark.full
@without(*QUICK_OF_STRETCH)
class TestCoarseStretchFull(CoarseStretch):
    """The rest."""


@pytest.mark.slow
class TestStretch(UVEmbeddingTests):
    name = "stretch"


@pytest.mark.slow
class TestLscm(UVEmbeddingTests):
    name = "lscm"
