"""Former names of public keywords and attributes, which still work and warn."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
Result = TypeVar("Result")


def renamed_keyword(old: str, new: str) -> Callable[[Callable[P, Result]], Callable[P, Result]]:
    """A decorator for functions whose keyword `old` is now called `new`."""

    def decorate(function: Callable[P, Result]) -> Callable[P, Result]:
        @functools.wraps(function)
        def call(*args: P.args, **kwargs: P.kwargs) -> Result:
            if old in kwargs and new not in kwargs:  # both together are refused by the function itself
                _warn(f"{function.__name__}({old}=...)", f"{new}=...")
                kwargs[new] = kwargs.pop(old)
            return function(*args, **kwargs)

        return call

    return decorate


def renamed_attribute(old: str, new: str) -> property:
    """The attribute `new`, to be read under the name `old`."""

    def read(record: object) -> Any:
        _warn(f"{type(record).__name__}.{old}", new)
        return getattr(record, new)

    return property(read)


def _warn(old: str, new: str) -> None:
    # level 3 is the caller of `call` or `read`: the line that has to change
    warnings.warn(f"{old} is now {new}; the old name goes with version 0.3.", DeprecationWarning, stacklevel=3)
