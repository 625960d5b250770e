"""The table: which tests of the kit catch which wrong renderer."""

from __future__ import annotations

from collections.abc import Callable, Set
from dataclasses import dataclass

from svbrdfgan.testing.kit import group_of, names_of_tests
from svbrdfgan.testing.renderer import RendererTests
from wrong.base import Right

SLOPES = (
    "test_base_color_of_every_texel_of_every_part",
    "test_base_color_of_textures_that_repeat",
    "test_base_color_where_parts_light_one_another",
)
"""One law, on three scenes."""

WHOLE = (
    "test_image_of_a_textured_plane",
    "test_image_of_a_floor_under_a_lid",
    "test_image_of_three_parts",
    "test_image_under_a_strong_sun",
    "test_image_in_low_light",
    "test_image_of_gloss",
    "test_texel_gradients_of_three_parts",
    "test_texel_gradients_in_shadow",
    "test_texel_gradients_under_a_strong_sun",
    "test_roughness_gradients_of_gloss",
    "test_image_of_metal_in_total",
    "test_image_of_whole_materials",
    "test_image_behind_clear_parts",
    "test_roughness_gradients_of_whole_materials",
    "test_metallic_gradients_of_whole_materials",
    "test_normal_gradients_of_whole_materials",
    "test_normal_gradients_of_bent_normals",
    "test_the_gradient_of_roughness_in_total",
    "test_the_gradient_of_metallic_in_total",
    "test_the_gradient_of_the_normal_in_total",
    "test_environment_gradient_in_the_open",
    "test_environment_gradient_through_shadow",
    "test_one_sample_is_unbiased",
    "test_sixteen_samples_are_unbiased",
    "test_gradients_of_one_sample_are_unbiased",
    "test_backward_samples_are_independent",
)
"""Those that hold whole pictures and gradients of textured scenes against quadrature: the last line of the kit, which
sees that something is wrong, but cannot say what. A test that can is to catch a wrong renderer as well."""


_AFFECTED = ("alpha", "deferred", "extremes", "materials", "normal_maps", "sizes")
AFFECTED = {
    *(name for name in names_of_tests(RendererTests) if group_of(RendererTests, name) in _AFFECTED),
    "test_many_parts",
    "test_white_is_as_bright_as_its_light_in_total",
    "test_base_color_beneath_all_maps",
    "test_base_color_behind_clear_parts",
    "test_interreflection_of_metal_as_numpy",
    "test_interreflection_behind_clear_parts_as_numpy",
    "test_memory_does_not_grow",
}
"""Those of materials and of stored light, which few renderers have, of sizes and of extremes: in light from one side,
on several parts, seen from all sides, in absolute numbers. They see faults of orientation, brightness, parts and
gradients as well, for which they are not meant; and that of memory, which threads take."""


@dataclass(frozen=True)
class Wrong:
    """A wrong renderer.

    Attributes:
        tests: all that catch it, but for those of `WHOLE`; of these only if it is for them to catch.
        whole: whether any other of `WHOLE` sees it, too. Which of them is a matter of the scenes.
        late: whether so little is wrong that it takes full power to find.
        reason: what is wrong; and why several tests catch it, where they do.
    """

    renderer: type[Right]
    tests: frozenset[str]
    whole: bool
    late: bool
    reason: str

    @property
    def size(self) -> str:
        """What is wrong, and by how much: the renderer's docstring."""
        return " ".join((self.renderer.__doc__ or "").split())

    def expects(self, failed: Set[str]) -> bool:
        """Whether these are the tests that should fail."""
        others = failed - self.tests
        whole = others & set(WHOLE)
        return self.tests <= failed and others <= {*WHOLE, *AFFECTED} and bool(whole) == self.whole


WRONG: list[Wrong] = []


def caught_by(
    *tests: str, whole: bool = False, late: bool = False, reason: str = ""
) -> Callable[[type[Right]], type[Right]]:
    """Enters a wrong renderer in the table."""

    def note(renderer: type[Right]) -> type[Right]:
        WRONG.append(Wrong(renderer, frozenset(tests), whole, late, f"{renderer.__doc__} {reason}".strip()))
        return renderer

    return note
