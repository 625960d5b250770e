"""The lists of tests that make up the tiers are right."""

from contextlib import suppress
from typing import Any
from unittest import SkipTest

import pytest
from tiers import AT_POWER

from svbrdfgan.plugins.registry import load_renderer
from svbrdfgan.testing import RendererTests
from svbrdfgan.testing.kit import FAST, names_of_tests


@pytest.mark.full
def test_only_tests_at_power_depend_on_power() -> None:
    """Run with `warp`, which is fast."""
    read = {name for name in names_of_tests(RendererTests) if _reads_power(name, "warp")}
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
