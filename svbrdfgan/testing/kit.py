"""Conformance kits: classes of tests about one plugin, run by pytest or by `svbrdfgan check`.

A test is a method named `test_*`, whose docstring says what holds. Where that does not hold, the test raises
`AssertionError`, with the numbers. A test of a capability that a plugin may lack calls `declared` first. No test needs
pytest: one that does not apply raises `unittest.SkipTest`, which pytest shows as skipped.
"""

from __future__ import annotations

import functools
import inspect
import time
import unittest
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar, Literal

FAST = 1 / 8
"""A power for test runs after each change: takes a third of the time. Errors must be 2.8 times as large to be found."""

Status = Literal["passed", "failed", "known failure", "not declared"]


class KnownFailure(unittest.SkipTest):
    """A test failed that the kit lists in `known_failures`."""


@dataclass(frozen=True)
class Outcome:
    """The result of one test.

    Attributes:
        group: the part of the kit that the test belongs to, such as "gradients".
        claim: what holds if it passes: the first line of its docstring.
        message: why it did not pass; empty if it did.
    """

    group: str
    name: str
    claim: str
    status: Status
    message: str
    seconds: float


class Kit:
    """Tests of one plugin. Subclass a kit, and set the plugin's name.

    Attributes:
        name: of its entry point.
        options: given to its constructor.
        power: share of the samples that statistical tests take, in (0, 1]. With a quarter of the samples, an error must
            be twice as large to be found with the same probability. A right plugin passes with the same probability.
        known_failures: names of tests that fail, with reasons. A listed test that passes is reported as failed.
    """

    name: ClassVar[str] = ""
    options: ClassVar[Mapping[str, object]] = MappingProxyType({})
    power: ClassVar[float] = 1.0
    known_failures: ClassVar[Mapping[str, str]] = MappingProxyType({})

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if not 0.0 < cls.power <= 1.0:
            raise TypeError(f"{cls.__name__}.power is {cls.power}; wanted more than 0 and at most 1.")
        for test, reason in cls.__dict__.get("known_failures", {}).items():
            if test not in names_of_tests(cls):
                raise TypeError(f"{cls.__name__}.known_failures names {test!r}, which is no test of this kit.")
            setattr(cls, test, _failing(getattr(cls, test), reason))


def declared(capability: bool, what: str) -> None:
    """Ends the test as "not declared" unless the plugin declares the capability."""
    if not capability:
        raise unittest.SkipTest(f"{what} is not declared")


def check(holds: bool, message: str) -> None:
    """Fails the test with a message, also where Python runs without assertions."""
    if not holds:
        raise AssertionError(message)


def names_of_tests(kit: type[Kit]) -> list[str]:
    """The names of the kit's tests: first those of its bases, in their order, then its own, as they are written."""
    inherited = [name for base in kit.__bases__ if issubclass(base, Kit) for name in names_of_tests(base)]
    return list(dict.fromkeys([*inherited, *(name for name in vars(kit) if name.startswith("test_"))]))


def run_kit(kit: type[Kit], only: str = "") -> Iterator[Outcome]:
    """Runs the tests whose "group.name" contains `only`, each on a new instance of the kit."""
    for name in names_of_tests(kit):
        group = group_of(kit, name)
        if only in f"{group}.{name}":
            yield _run(kit, group, name)


def _run(kit: type[Kit], group: str, name: str) -> Outcome:
    claim = (inspect.getdoc(getattr(kit, name)) or name).splitlines()[0]
    status: Status
    status, message, start = "passed", "", time.perf_counter()
    try:
        getattr(kit(), name)()
    except unittest.SkipTest as reason:
        status, message = "known failure" if isinstance(reason, KnownFailure) else "not declared", str(reason)
    except AssertionError as error:
        status, message = "failed", str(error)
    except Exception as error:
        status, message = "failed", f"{type(error).__name__}: {error}"
    return Outcome(group, name, claim, status, message, time.perf_counter() - start)


def group_of(kit: type[Kit], name: str) -> str:
    """The test's group: the module of the class that wrote it first."""
    first = next(owner for owner in reversed(kit.__mro__) if name in vars(owner))
    return first.__module__.rpartition(".")[2]


def _failing(test: Callable[[Any], None], reason: str) -> Callable[[Any], None]:
    @functools.wraps(test)
    def run(self: Any) -> None:
        try:
            test(self)
        except unittest.SkipTest:
            raise
        except Exception as error:
            raise KnownFailure(reason) from error
        raise AssertionError(f"it passes, but known_failures says: {reason}; remove it there.")

    return run
