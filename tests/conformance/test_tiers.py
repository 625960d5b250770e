"""The lists of tests that make up the tiers are right."""

from contextlib import suppress
from typing import Any
from unittest import SkipTest

import pytest
from tiers import AT_POWER

from svbrdfgan.plugins import load_renderer
from svbrdfgan.testing import RendererTests
from svbrdfgan.testing.kit import FAST, names_of_tests


@pytest.mark.full
def test_only_tests_at_power_depend_on_power() -> None:
    """Run with `warp`, which is fast, and with `numpy` for the tests of roughness."""
    read: set[str] = set()
    for name in names_of_tests(RendererTests):
        for renderer in ("warp", "numpy") if "rough" in name or "gloss" in name else ("warp",):
            read |= {name} if _reads_power(name, renderer) else set()
    assert read <= set(AT_POWER)
    assert len(read) > 40


def _reads_power(test: str, renderer: str) -> bool:
    read = []

    class Watched(RendererTests):
        name = renderer

        def make_renderer(self) -> Any:
            return load_renderer(renderer, {"device": "cpu"} if renderer == "warp" else {})

    def power(self: Watched) -> float:
        read.append(test)
        return FAST

    Watched.power = property(power)  # type: ignore[assignment]
    with suppress(SkipTest):
        getattr(Watched(), test)()
    return bool(read)
