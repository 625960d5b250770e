"""The kit of renderers catches each of these wrong ones, by the tests meant for it and by no other."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest
import torch
from wrong import WHOLE, WRONG, Right, Wrong
from wrong.base import Call
from wrong.limits import LEAST
from wrong.running import failures, outcomes
from wrong.stored_light import Deferring
from wrong.table import AFFECTED

from svbrdfgan.testing.kit import FAST, names_of_tests
from svbrdfgan.testing.renderer import RendererTests, resources

NEIGHBOURS = (
    "test_its_repr_is_one_line",
    "test_gradients_are_of_what_is_asked",
    "test_inputs_are_only_read",
    "test_pictures_are_shaped_as_the_film",
    "test_gradients_are_shaped_as_the_maps",
    "test_no_light_is_black",
    "test_channels_do_not_mix",
    "test_pictures_are_multiplied_by_coverage",
    "test_textures_are_clamped_at_the_border",
    "test_right_is_right",
    "test_texture_row_0_is_at_the_bottom",
    "test_surfaces_have_two_sides",
    "test_each_part_has_its_own_material",
    "test_linear_in_the_cotangent",
    "test_a_part_without_normals_stays_flat",
    "test_same_seed_same_picture",
    "test_transport_times_texture_is_the_picture",
)
"""One or two quick tests from each group: what the quick half of this page runs beside the tests that should fail."""
SLOW = (
    "test_base_color_behind_clear_parts",
    "test_image_behind_clear_parts",
    "test_environment_moves_the_picture",
    "test_stored_light_gives_the_picture",
    "test_stored_light_behind_clear_parts_gives_the_picture",
)
"""Tests that the quick half of this page comes to last, the slowest after all others."""


class WithoutChance(Right):
    """A right renderer that takes the same samples each time, so many that chance is small."""

    claims = MappingProxyType({"stochastic": False, "transport": False, "deferred": False})

    def asked(self, call: Call) -> Call:
        return replace(call, seed=0, spp=8 * call.spp)


class WithoutAnIndex(Right):
    """A right renderer that names its device as its results do not: "cuda" for "cuda:0", in effect."""

    @property
    def device(self) -> torch.device:
        return torch.device("cpu", 0)


def each(wrongs: list[Wrong]) -> Any:
    return pytest.mark.parametrize("wrong", wrongs, ids=lambda wrong: wrong.renderer.__name__)


@pytest.fixture(autouse=True)
def _able(request: pytest.FixtureRequest) -> None:
    """Of the right renderers, `warp` alone stores light."""
    wrong = request.node.callspec.params.get("wrong") if hasattr(request.node, "callspec") else None
    if wrong and issubclass(wrong.renderer, Deferring) and not Right().capabilities.deferred:
        pytest.skip("stored light needs the warp renderer")


@each([wrong for wrong in WRONG if not wrong.late])
def test_each_wrong_one_is_caught_at_little_power(wrong: Wrong, monkeypatch: pytest.MonkeyPatch) -> None:
    """By one of the tests meant for it, or more: `wrong_table.py` says by which.

    The third time at the latest: a process that has run thousands of tests may just free what those have left, and so
    hide what grows (twice in three runs of all tests, 10 kB of each render).
    """
    monkeypatch.setattr(resources, "ROUNDS", 5)
    monkeypatch.setattr(resources, "LATER", 3)
    quick_first = sorted(wrong.tests, key=lambda test: (SLOW.index(test) if test in SLOW else -1, test))
    assert any(failures(wrong.renderer, test, power=FAST) for _ in range(3) for test in quick_first)


@pytest.mark.parametrize(("kept", "leaks"), [([600] * 7 + [0] * 7, False), ([600] * 7 + [2600] * 7, True)])
def test_what_grows_by_chance_is_looked_at_again(kept: list[int], leaks: bool) -> None:
    """Kept are the bytes of each round: of five renders, then of 25."""
    level = iter(np.cumsum(kept))
    check = resources.ResourceTests._require_no_growth
    growth: Any = (None, lambda seed: None, {"bytes": lambda: int(next(level))}, {"bytes": 100.0})
    with pytest.raises(AssertionError, match=r"bytes grew by 104\.0") if leaks else nullcontext():
        check(*growth)


@pytest.mark.full
@each(WRONG)
def test_each_wrong_one_is_caught(wrong: Wrong) -> None:
    """By all the tests meant for it, and by none of their neighbours, but for those of materials that few have."""
    failed = failures(wrong.renderer, *wrong.tests, *NEIGHBOURS)
    assert failed.keys() - (AFFECTED - wrong.tests) == wrong.tests, failed


@pytest.mark.full
@pytest.mark.parametrize(("renderer", "least"), LEAST, ids=lambda value: getattr(value, "__name__", ""))
def test_the_least_that_is_said_to_be_found_is_found(renderer: type[Right], least: dict[str, float]) -> None:
    (wrong,) = (wrong for wrong in WRONG if wrong.renderer is renderer)
    assert failures(type(renderer.__name__, (renderer,), least), *wrong.tests).keys() == wrong.tests


@pytest.mark.slow
@each(WRONG)
def test_each_wrong_one_is_caught_by_no_other_test(wrong: Wrong) -> None:
    failed = failures(wrong.renderer)
    assert wrong.expects(failed.keys()), failed


@pytest.mark.slow
def test_the_right_one_passes() -> None:
    assert failures(Right) == {}


@pytest.mark.full
def test_one_without_chance_passes() -> None:
    """The kit can be passed without chance, and without being exact."""
    found = {outcome.name: outcome for outcome in outcomes(WithoutChance)}
    assert {name: o.message for name, o in found.items() if o.status == "failed"} == {}
    assert sum(outcome.status == "passed" for outcome in found.values()) > 90


def test_a_device_may_be_named_without_its_index() -> None:
    assert failures(WithoutAnIndex, "shapes.test_pictures_are", "shapes.test_transport_is") == {}


def test_the_table_names_tests_of_the_kit() -> None:
    named = {name for wrong in WRONG for name in wrong.tests}
    assert {*named, *NEIGHBOURS, *WHOLE} <= set(names_of_tests(RendererTests))
