"""Distributions as they are written in a configuration file.

`5` or `{fixed: 5}` · `{uniform: [0, 360]}` · `{normal: [20, 5]}` (mean, standard deviation) · `{choice: [a, b, c]}`
"""

from __future__ import annotations

from typing import Annotated, Any, Generic, TypeVar

import numpy as np
from pydantic import BeforeValidator, model_validator

from svbrdfgan.options import StrictModel

T = TypeVar("T")
Color = tuple[Annotated[float, "linear red"], Annotated[float, "linear green"], Annotated[float, "linear blue"]]


class Fixed(StrictModel, Generic[T]):
    """Always the same value."""

    fixed: T

    def sample(self, rng: np.random.Generator) -> T:
        return self.fixed


class Choice(StrictModel, Generic[T]):
    """One of several values, equally likely."""

    choice: tuple[T, ...]

    @model_validator(mode="after")
    def _not_empty(self) -> Choice[T]:
        if not self.choice:
            raise ValueError("choice needs at least one value")
        return self

    def sample(self, rng: np.random.Generator) -> T:
        return self.choice[int(rng.integers(len(self.choice)))]


class Uniform(StrictModel):
    """Any number between two, equally likely."""

    uniform: tuple[float, float]

    @model_validator(mode="after")
    def _ordered(self) -> Uniform:
        if not self.uniform[0] <= self.uniform[1]:
            raise ValueError(f"uniform needs [low, high] with low <= high, not {list(self.uniform)}")
        return self

    def sample(self, rng: np.random.Generator) -> float:
        return float(rng.uniform(*self.uniform))


class Normal(StrictModel):
    """A number from a Gaussian: mean, standard deviation."""

    normal: tuple[float, float]

    @model_validator(mode="after")
    def _positive(self) -> Normal:
        if self.normal[1] < 0:
            raise ValueError(f"normal needs [mean, deviation] with deviation >= 0, not {list(self.normal)}")
        return self

    def sample(self, rng: np.random.Generator) -> float:
        return float(rng.normal(*self.normal))


def _plain_is_fixed(value: Any) -> Any:
    return value if isinstance(value, dict | StrictModel) else {"fixed": value}


Number = Annotated[Fixed[float] | Uniform | Normal | Choice[float], BeforeValidator(_plain_is_fixed)]
"""A distribution over numbers."""

Integer = Annotated[Fixed[int] | Choice[int], BeforeValidator(_plain_is_fixed)]
"""A distribution over whole numbers."""

Paint = Annotated[Fixed[Color] | Choice[Color], BeforeValidator(_plain_is_fixed)]
"""A distribution over linear RGB reflectances."""
