"""Sums over equal keys, by sorting: the same to the last bit in every run, on CUDA too."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor


@dataclass(frozen=True, eq=False)
class Runs:
    """Rows of equal keys, brought together.

    Attributes:
        key: each key once, ascending.
        length: how many rows have it.
        order: all rows, those of the first key first; rows of the same key in their own order.
    """

    key: Int[Tensor, " runs"]
    length: Int[Tensor, " runs"]
    order: Int[Tensor, " rows"]

    @classmethod
    def of(cls, key: Int[Tensor, " rows"]) -> Runs:
        ascending, order = key.sort(stable=True)
        once, length = torch.unique_consecutive(ascending, return_counts=True)
        return cls(once, length, order)

    def first(self) -> Int[Tensor, " runs"]:
        """The first row of each run."""
        return self.order[self.length.cumsum(0) - self.length]


@dataclass(frozen=True, eq=False)
class Entries:
    """Values by key. A key may occur several times, and then means the sum."""

    key: Int[Tensor, " entries"]
    value: Float[Tensor, "entries channels"]

    @classmethod
    def joined(cls, several: Sequence[Entries]) -> Entries:
        """All of these."""
        return cls(torch.cat([entries.key for entries in several]), torch.cat([entries.value for entries in several]))

    def merged(self) -> Entries:
        """The same with each key once, ascending."""
        runs = Runs.of(self.key)
        return Entries(runs.key, segment_sums(self.value[runs.order], runs.length))


def segment_sums(values: Float[Tensor, "rows ..."], length: Int[Tensor, " segments"]) -> Float[Tensor, "segments ..."]:
    """The sums of so many rows each, one segment after the other."""
    if not len(values):
        return values.new_zeros(len(length), *values.shape[1:])
    return torch.segment_reduce(values, "sum", lengths=length, unsafe=True)
