"""The in-tree renderers pass the kit that is shipped for everybody's.

The fast tier runs it at little power, with several bounces only where these can change the result. The full tier runs
what is left: the statistical tests at full power, and all others with several bounces.

A backend whose package is not installed is skipped, unless SVBRDFGAN_REQUIRED_BACKENDS names it.
"""

import os
from collections.abc import Mapping
from importlib.util import find_spec
from typing import ClassVar

import pytest
import torch
from tiers import AT_POWER, CHANGED_BY_BOUNCES, IN_TOTAL, only, without

from svbrdfgan.plugins.registry import RENDERERS, list_plugins
from svbrdfgan.testing import RendererTests
from svbrdfgan.testing.kit import FAST

REQUIRED = os.environ.get("SVBRDFGAN_REQUIRED_BACKENDS", "").split()
INSTALLED = {plugin.name for plugin in list_plugins(RENDERERS)}
SLOW_WITHOUT_BOUNCES = ("test_memory_does_not_grow",)
SLOW_WITH_BOUNCES = ("test_pullback_is_the_gradient", "test_interreflection_behind_clear_parts_as_numpy")
SLOW_WITH_STORED_LIGHT = ("test_stored_light_behind_clear_parts_gives_the_picture",)


class Backend(RendererTests):
    """Of the class's `name`, on the class's `device` if it has one to choose; needs `package`."""

    package: ClassVar[str] = ""
    device: ClassVar[str] = ""

    @pytest.fixture(autouse=True)
    def _needs(self) -> None:
        if self.name not in REQUIRED:
            if self.name not in INSTALLED:
                pytest.skip(f"there is no renderer {self.name!r}")
            if self.package and find_spec(self.package) is None:  # found, not imported: that is the backend's business
                pytest.skip(f"{self.name} needs {self.package}")
        if self.device == "cuda" and not torch.cuda.is_available():
            pytest.skip("there is no CUDA device")


@without(*SLOW_WITHOUT_BOUNCES, *IN_TOTAL)
class TestNumpy(Backend):
    name, power = "numpy", FAST


@only(*CHANGED_BY_BOUNCES)
class TestNumpyBounces(Backend):
    name, power = "numpy", FAST
    options: ClassVar[Mapping[str, object]] = {"max_bounces": 3}


@without(*SLOW_WITHOUT_BOUNCES, *SLOW_WITH_STORED_LIGHT, *IN_TOTAL)
class TestWarp(Backend):
    name, package, power = "warp", "warp", FAST
    options: ClassVar[Mapping[str, object]] = {"device": "cpu"}


@without(*SLOW_WITHOUT_BOUNCES, *IN_TOTAL)
class TestMitsuba(Backend):
    name, package, power = "mitsuba", "mitsuba", FAST
    options: ClassVar[Mapping[str, object]] = {"device": "cpu"}


@only(*(test for test in CHANGED_BY_BOUNCES if test not in SLOW_WITH_BOUNCES))
class TestMitsubaBounces(Backend):
    name, package, power = "mitsuba", "mitsuba", FAST
    options: ClassVar[Mapping[str, object]] = {"device": "cpu", "max_bounces": 3}


@pytest.mark.full
@only(*AT_POWER, *SLOW_WITHOUT_BOUNCES)
class TestNumpyFull(Backend):
    name = "numpy"


@pytest.mark.full
@without(*set(CHANGED_BY_BOUNCES) - set(AT_POWER))
class TestNumpyBouncesFull(Backend):
    name = "numpy"
    options: ClassVar[Mapping[str, object]] = {"max_bounces": 3}


@pytest.mark.full
@only(*AT_POWER, *SLOW_WITHOUT_BOUNCES)
class TestWarpFull(Backend):
    name, package = "warp", "warp"
    options: ClassVar[Mapping[str, object]] = {"device": "cpu"}


@pytest.mark.full
class TestWarpCuda(Backend):
    name, package, device = "warp", "warp", "cuda"
    options: ClassVar[Mapping[str, object]] = {"device": "cuda"}


@pytest.mark.full
@only(*AT_POWER, *SLOW_WITHOUT_BOUNCES)
class TestMitsubaFull(Backend):
    name, package = "mitsuba", "mitsuba"
    options: ClassVar[Mapping[str, object]] = {"device": "cpu"}


@pytest.mark.full
@without(*set(CHANGED_BY_BOUNCES) - set(AT_POWER) - set(SLOW_WITH_BOUNCES))
class TestMitsubaBouncesFull(Backend):
    name, package = "mitsuba", "mitsuba"
    options: ClassVar[Mapping[str, object]] = {"device": "cpu", "max_bounces": 3}


@pytest.mark.full
class TestMitsubaCuda(Backend):
    name, package, device = "mitsuba", "mitsuba", "cuda"
    options: ClassVar[Mapping[str, object]] = {"device": "cuda"}


def test_required_backends_are_known() -> None:
    """Nothing that must be tested is skipped for a misspelt name."""
    assert set(REQUIRED) <= INSTALLED
    assert {"numpy", "warp"} <= INSTALLED
