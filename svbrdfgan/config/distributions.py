"""Distributions, as written in a configuration file.

`5` or `{fixed: 5}` · `{uniform: [0, 360]}` · `{log_uniform: [0.1, 1]}` · `{normal: [20, 5]}` (mean and
standard deviation) · `{choice: [a, b, c]}`
"""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar, Generic, TypeVar

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Discriminator, Tag, model_validator

from svbrdfgan.config.models import StrictModel

T = TypeVar("T")
Color = tuple[float, float, float]
"""Linear RGB."""


class Fixed(StrictModel, Generic[T]):
    """A constant value."""

    fixed: T

    def sample(self, rng: np.random.Generator) -> T:
        return self.fixed


class Choice(StrictModel, Generic[T]):
    """A value of several, equally likely."""

    choice: tuple[T, ...]

    @model_validator(mode="after")
    def _not_empty(self) -> Choice[T]:
        if not self.choice:
            raise ValueError("choice needs at least one value")
        return self

    def sample(self, rng: np.random.Generator) -> T:
        return self.choice[int(rng.integers(len(self.choice)))]


class Uniform(StrictModel):
    """A number between two bounds, equally likely."""

    uniform: tuple[float, float]
    most: ClassVar[float] = 1e12

    @model_validator(mode="after")
    def _ordered(self) -> Uniform:
        if not self.uniform[0] <= self.uniform[1]:
            raise ValueError(f"uniform needs [low, high] with low <= high, not {list(self.uniform)}")
        _require_moderate(self.uniform, self.most)
        return self

    def sample(self, rng: np.random.Generator) -> float:
        return float(rng.uniform(*self.uniform))


class UniformInteger(Uniform):
    """An integer between two bounds, both included, equally likely."""

    uniform: tuple[int, int]
    most: ClassVar[float] = 2**64  # each field says what it takes

    def sample(self, rng: np.random.Generator) -> int:
        return int(rng.integers(*self.uniform, endpoint=True))


class LogUniform(StrictModel):
    """A number between two bounds above zero, whose logarithm is equally likely."""

    log_uniform: tuple[float, float]

    @model_validator(mode="after")
    def _ordered(self) -> LogUniform:
        if not 0.0 < self.log_uniform[0] <= self.log_uniform[1]:
            raise ValueError(f"log_uniform needs [low, high] with 0 < low <= high, not {list(self.log_uniform)}")
        _require_moderate(self.log_uniform)
        return self

    def sample(self, rng: np.random.Generator) -> float:
        low, high = self.log_uniform
        return min(max(math.exp(rng.uniform(math.log(low), math.log(high))), low), high)


class Normal(StrictModel):
    """A number from a Gaussian, given by its mean and standard deviation."""

    normal: tuple[float, float]

    @model_validator(mode="after")
    def _positive(self) -> Normal:
        if self.normal[1] < 0:
            raise ValueError(f"normal needs [mean, deviation] with deviation >= 0, not {list(self.normal)}")
        _require_moderate(self.normal)
        return self

    def sample(self, rng: np.random.Generator) -> float:
        return float(rng.normal(*self.normal))


def _require_moderate(numbers: tuple[float, float], most: float = Uniform.most) -> None:
    """Refuses numbers whose differences and powers would overflow."""
    if max(map(abs, numbers)) > most:
        raise ValueError(f"{list(numbers)} is out of range; wanted numbers up to {most:g}")


def _kind(value: Any) -> str | None:
    """The distribution that is meant, so that errors are reported for that one only."""
    if isinstance(value, dict):
        return next(iter(value)) if len(value) == 1 and next(iter(value)) in _KINDS else None
    return next(iter(type(value).model_fields)) if isinstance(value, StrictModel) else "plain"


def _fixed(value: Any) -> dict[str, Any]:
    return {"fixed": tuple(value) if isinstance(value, list) else value}


_KINDS = ("fixed", "uniform", "log_uniform", "normal", "choice")
_WANTED = (
    "a value, {fixed: value}, {uniform: [low, high]}, {log_uniform: [low, high]}, {normal: [mean, deviation]} or "
    "{choice: [one, another]}"
)
_BY_KIND = Discriminator(_kind, custom_error_type="distribution", custom_error_message=_WANTED)

Number = Annotated[
    Annotated[Fixed[float], BeforeValidator(_fixed), Tag("plain")]
    | Annotated[Fixed[float], Tag("fixed")]
    | Annotated[Uniform, Tag("uniform")]
    | Annotated[LogUniform, Tag("log_uniform")]
    | Annotated[Normal, Tag("normal")]
    | Annotated[Choice[float], Tag("choice")],
    _BY_KIND,
]
"""A distribution over numbers."""


def within(low: float, high: float = math.inf) -> AfterValidator:
    """Refuses values, bounds and choices outside [low, high]. The sampler clamps what `normal` draws."""

    def check(declared: Any) -> Any:
        match declared:
            case Fixed():
                given = [declared.fixed]
            case Uniform():
                given = list(declared.uniform)
            case LogUniform():
                given = list(declared.log_uniform)
            case Choice():
                given = list(declared.choice)
            case _:
                return declared
        for value in given:
            if not all(low <= number <= high for number in (value if isinstance(value, tuple) else (value,))):
                wanted = f"at least {low:g}" if high == math.inf else f"from {low:g} to {high:g}"
                raise ValueError(f"{value} is not allowed; wanted numbers {wanted}")
        return declared

    return AfterValidator(check)


def values_of(declared: Fixed[T] | Choice[T]) -> tuple[T, ...]:
    """The different values that can be drawn, in their order."""
    return tuple(dict.fromkeys(declared.choice)) if isinstance(declared, Choice) else (declared.fixed,)


def limits(declared: Number, low: float, high: float) -> tuple[float, float]:
    """The least and the greatest value that can be drawn, clamped to [low, high].

    For `normal` with any deviation these are the bounds themselves.
    """
    match declared:
        case Uniform():
            ends = declared.uniform
        case LogUniform():
            ends = declared.log_uniform
        case Normal():
            ends = (low, high) if declared.normal[1] else (declared.normal[0],) * 2
        case _:
            ends = min(values_of(declared)), max(values_of(declared))
    return min(max(ends[0], low), high), min(max(ends[1], low), high)


def mean(declared: Number) -> float:
    """The expected value."""
    match declared:
        case Fixed():
            return declared.fixed
        case Uniform():
            return sum(declared.uniform) / 2
        case LogUniform():
            low, high = declared.log_uniform
            return (high - low) / math.log(high / low) if low < high else low
        case Normal():
            return declared.normal[0]
        case Choice():
            return sum(declared.choice) / len(declared.choice)


Integer = Annotated[
    Annotated[Fixed[int], BeforeValidator(_fixed), Tag("plain")]
    | Annotated[Fixed[int], Tag("fixed")]
    | Annotated[UniformInteger, Tag("uniform")]
    | Annotated[Choice[int], Tag("choice")],
    _BY_KIND,
]
"""A distribution over whole numbers."""

Name = Annotated[
    Annotated[Fixed[str], BeforeValidator(_fixed), Tag("plain")]
    | Annotated[Fixed[str], Tag("fixed")]
    | Annotated[Choice[str], Tag("choice")],
    _BY_KIND,
]
"""A distribution over names."""

Paint = Annotated[
    Annotated[Fixed[Color], BeforeValidator(_fixed), Tag("plain")]
    | Annotated[Fixed[Color], Tag("fixed")]
    | Annotated[Choice[Color], Tag("choice")],
    _BY_KIND,
]
"""A distribution over linear RGB reflectances."""
