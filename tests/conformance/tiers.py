"""Which tests of the renderers' kit belong to which tier, and how a class takes only some of a kit."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import TypeVar

from svbrdfgan.testing import RendererTests
from svbrdfgan.testing.kit import Kit, group_of, names_of_tests

_STATISTICAL = (
    "agreement",
    "alpha",
    "deferred",
    "extremes",
    "map_gradients",
    "materials",
    "normal_maps",
    "orientation",
    "radiometry",
    "randomness",
)

AT_POWER = (
    *(name for name in names_of_tests(RendererTests) if group_of(RendererTests, name) in _STATISTICAL),
    "test_environment_moves_the_picture",
)
"""All tests whose samples `Kit.power` decides, and few others; `test_tiers.py` checks it."""

IN_TOTAL = (
    "test_image_of_metal_in_total",
    "test_the_gradient_of_roughness_in_total",
    "test_the_gradient_of_metallic_in_total",
    "test_the_gradient_of_the_normal_in_total",
    "test_gradients_of_stored_light_in_total",
)
"""Tests that find 1 % or less: too slow for the fast tier even at little power."""

CHANGED_BY_BOUNCES = (
    "test_capabilities_name_what_exists",
    "test_same_seed_same_picture",
    "test_a_pullback_keeps_what_it_was_given",
    "test_light_bounces_as_often_as_declared",
    "test_direct_light_takes_no_colour_from_other_parts",
    "test_base_color_where_parts_light_one_another",
    "test_environment_moves_the_picture",
    "test_linear_in_the_cotangent",
    "test_inputs_together_are_as_each_alone",
    "test_pullback_is_the_gradient",
    "test_render_layer_gives_torch_these_gradients",
    "test_interreflection_as_numpy",
    "test_interreflection_of_metal_as_numpy",
    "test_interreflection_behind_clear_parts_as_numpy",
    "test_paths_pass_what_is_not_there",
    "test_base_color_beneath_all_maps",
)
"""Tests whose scene has surfaces that light one another, or whose subject is what several bounces allow."""

AnyKit = TypeVar("AnyKit", bound=type[Kit])


def only(*tests: str) -> Callable[[AnyKit], AnyKit]:
    """Hides all other tests of the kit from pytest."""
    return lambda kit: _hidden(kit, [name for name in names_of_tests(kit) if name not in tests], tests)


def without(*tests: str) -> Callable[[AnyKit], AnyKit]:
    """Hides these tests of the kit from pytest."""
    return lambda kit: _hidden(kit, tests, tests)


def _hidden(kit: AnyKit, hidden: Collection[str], named: Collection[str]) -> AnyKit:
    unknown = set(named) - set(names_of_tests(kit))
    assert not unknown, f"no test of {kit.__name__} is called {sorted(unknown)}"
    for name in hidden:
        setattr(kit, name, None)
    return kit
