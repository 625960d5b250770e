"""The machinery of the kits: which tests there are, what becomes of them, and failures that are known."""

import unittest
from collections import Counter
from typing import Any

import pytest

from svbrdfgan.plugins.registry import load_embedding, load_renderer
from svbrdfgan.testing import RendererTests, UVEmbeddingTests
from svbrdfgan.testing.kit import Kit, KnownFailure, check, declared, names_of_tests, run_kit


class Holding(Kit):
    def test_one(self) -> None:
        """One is one.

        More about it.
        """
        check(1 == 1, "one is not one")

    def test_lacking(self) -> None:
        """Powers may be lacking."""
        declared(False, "this power")


class Breaking(Kit):
    def test_wrong(self) -> None:
        """Two is three."""
        check(2 == 3, "2 is not 3")

    def test_raising(self) -> None:
        raise KeyError("lost")


class Both(Holding, Breaking):
    """Two groups."""


def statuses(kit: type[Kit], only: str = "") -> dict[str, str]:
    return {outcome.name: outcome.status for outcome in run_kit(kit, only)}


def test_groups_come_in_the_order_listed_and_tests_in_the_order_written() -> None:
    assert names_of_tests(Both) == ["test_one", "test_lacking", "test_wrong", "test_raising"]


def test_what_groups_have_in_common_comes_first_and_what_a_kit_adds_last() -> None:
    class Common(Kit):
        def test_common(self) -> None: ...

    class First(Common):
        def test_z(self) -> None: ...

        def test_y(self) -> None: ...

    class Second(Common):
        def test_a(self) -> None: ...

    class Whole(First, Second):
        known_failures = {"test_a": "it is not written"}

        def test_own(self) -> None: ...

    assert names_of_tests(Whole) == ["test_common", "test_z", "test_y", "test_a", "test_own"]
    assert [outcome.name for outcome in run_kit(Whole)] == names_of_tests(Whole)


def test_the_groups_of_renderers_are_run_as_listed() -> None:
    groups = [group.__module__ for group in RendererTests.__bases__]
    owners = [next(g for g in RendererTests.__bases__ if name in dir(g)) for name in names_of_tests(RendererTests)]
    assert list(dict.fromkeys(owner.__module__ for owner in owners)) == groups


def test_a_test_written_anew_keeps_its_place() -> None:
    class Again(Both):
        def test_lacking(self) -> None:
            """Not any more."""

    assert names_of_tests(Again) == names_of_tests(Both)
    assert statuses(Again)["test_lacking"] == "passed"


def test_every_status_and_its_message() -> None:
    outcomes = {outcome.name: outcome for outcome in run_kit(Both)}
    found = {name: (outcome.status, outcome.message) for name, outcome in outcomes.items()}
    assert found == {
        "test_one": ("passed", ""),
        "test_lacking": ("not declared", "this power is not declared"),
        "test_wrong": ("failed", "2 is not 3"),
        "test_raising": ("failed", "KeyError: 'lost'"),
    }
    assert (outcomes["test_one"].claim, outcomes["test_raising"].claim) == ("One is one.", "test_raising")
    assert all(outcome.group == "test_kit" and outcome.seconds >= 0.0 for outcome in outcomes.values())


def test_only_some() -> None:
    assert list(statuses(Both, "wrong")) == ["test_wrong"]
    assert list(statuses(Both, "test_kit.test_one")) == ["test_one"]
    assert statuses(Both, "no such test") == {}


def test_a_known_failure_is_not_a_failure_and_says_why() -> None:
    class Known(Both):
        known_failures = {"test_wrong": "arithmetic is hard", "test_raising": "lost for good"}

    found = {outcome.name: (outcome.status, outcome.message) for outcome in run_kit(Known)}
    assert found["test_wrong"] == ("known failure", "arithmetic is hard")
    assert found["test_raising"] == ("known failure", "lost for good")
    with pytest.raises(KnownFailure, match="arithmetic is hard"):  # what pytest takes for a skip
        Known().test_wrong()
    assert statuses(Both)["test_wrong"] == "failed"


def test_a_known_failure_that_passes_fails() -> None:
    class Mended(Both):
        known_failures = {"test_one": "was broken"}

    (outcome,) = run_kit(Mended, "test_one")
    assert outcome.status == "failed"
    assert "known_failures says: was broken" in outcome.message


def test_a_known_failure_that_is_not_declared_is_not_declared() -> None:
    class Lacking(Both):
        known_failures = {"test_lacking": "it would fail"}

    assert statuses(Lacking)["test_lacking"] == "not declared"


def test_known_failures_name_tests() -> None:
    with pytest.raises(TypeError, match="'test_typo', which is no test"):
        type("Typo", (Both,), {"known_failures": {"test_typo": "reason"}})


@pytest.mark.parametrize("power", [0.0, -0.5, 1.5])
def test_power_is_a_share(power: float) -> None:
    with pytest.raises(TypeError, match=r"wanted more than 0 and at most 1\."):
        type("Wrong", (Both,), {"power": power})


def test_checks_hold_where_assertions_are_off() -> None:
    with pytest.raises(AssertionError, match="message"):
        check(False, "message")
    with pytest.raises(unittest.SkipTest, match="gloss is not declared"):
        declared(False, "gloss")


def test_each_test_has_an_object_of_its_own() -> None:
    class Counting(Kit):
        count = 0

        def test_a(self) -> None:
            self.count += 1
            check(self.count == 1, "shared")

        def test_b(self) -> None:
            self.test_a()

    assert set(statuses(Counting).values()) == {"passed"}


@pytest.mark.parametrize("kit", [RendererTests, UVEmbeddingTests])
def test_groups_do_not_override_one_another(kit: type[Kit]) -> None:
    """The groups are joined into one class: a name that two of them use would silently be one of the two."""
    ignored = {"__module__", "__qualname__", "__doc__", "__dict__", "__weakref__", "__firstlineno__"}
    ignored |= {"__static_attributes__", "__annotations__", "__orig_bases__", "__parameters__"}
    shared = set.intersection(*(set(group.__mro__) for group in kit.__bases__))
    owners = {owner for group in kit.__bases__ for owner in group.__mro__} - shared
    used = Counter(name for owner in owners for name in vars(owner) if name not in ignored)
    assert [name for name, count in used.items() if count > 1] == []


@pytest.mark.parametrize(
    ("kit", "maker", "plugin"),
    [
        (RendererTests, "make_renderer", lambda self: load_renderer("numpy")),
        (UVEmbeddingTests, "make_embedding", lambda self: load_embedding("hemispherical")),
    ],
)
def test_one_that_is_not_installed_may_have_a_name(kit: type[Any], maker: str, plugin: Any) -> None:
    own = type("Own", (kit,), {"name": "not-installed", maker: plugin})
    assert statuses(own, "test_its_entry_point") == {"test_its_entry_point_finds_it": "not declared"}
    assert statuses(own, "test_options_have") == {"test_options_have_types_and_defaults": "passed"}


@pytest.mark.parametrize("kit", [RendererTests, UVEmbeddingTests])
def test_every_test_says_what_holds(kit: type[Any]) -> None:
    names = names_of_tests(kit)
    claims = [(getattr(kit, name).__doc__ or "").splitlines()[0] for name in names]
    assert len(names) > 20
    assert all(claim.endswith(".") and len(claim) < 115 for claim in claims)
    assert len(set(claims)) == len(claims)
