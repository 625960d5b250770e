"""The in-tree renderers pass the kit that is shipped for everybody's.

A backend whose package is not installed is skipped, unless SVBRDFGAN_REQUIRED_BACKENDS names it.
"""

import os
from collections.abc import Mapping
from importlib.util import find_spec
from typing import ClassVar

import pytest
import torch

from svbrdfgan.plugins import RENDERERS, list_plugins
from svbrdfgan.testing import RendererTests

REQUIRED = os.environ.get("SVBRDFGAN_REQUIRED_BACKENDS", "").split()
INSTALLED = {plugin.name for plugin in list_plugins(RENDERERS)}


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


class TestNumpy(Backend):
    name = "numpy"


class TestNumpyBounces(Backend):
    name = "numpy"
    options: ClassVar[Mapping[str, object]] = {"max_bounces": 3}


class TestWarp(Backend):
    name, package = "warp", "warp"
    options: ClassVar[Mapping[str, object]] = {"device": "cpu"}


class TestWarpCuda(Backend):
    name, package, device = "warp", "warp", "cuda"
    options: ClassVar[Mapping[str, object]] = {"device": "cuda"}


class TestMitsuba(Backend):
    name, package = "mitsuba", "mitsuba"
    options: ClassVar[Mapping[str, object]] = {"device": "cpu"}


class TestMitsubaBounces(Backend):
    name, package = "mitsuba", "mitsuba"
    options: ClassVar[Mapping[str, object]] = {"device": "cpu", "max_bounces": 3}


class TestMitsubaCuda(Backend):
    name, package, device = "mitsuba", "mitsuba", "cuda"
    options: ClassVar[Mapping[str, object]] = {"device": "cuda"}


def test_required_backends_are_known() -> None:
    """Nothing that must be tested is skipped for a misspelt name."""
    assert set(REQUIRED) <= INSTALLED
    assert {"numpy", "warp"} <= INSTALLED
