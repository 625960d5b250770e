"""Sums over equal keys, by sorting, so that they are the same bit for bit in every run, on CUDA too."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor


@dataclass(frozen=True, eq=False)
class Runs:
    """Rows grouped by equal keys.

    Attributes:
        key: each key once, ascending.
        length: rows of each key.
        order: all rows, by ascending key; rows of one key keep their order.
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
    """Values by key. A key may occur several times; its value is the sum."""

    key: Int[Tensor, " entries"]
    value: Float[Tensor, "entries channels"]

    @classmethod
    def joined(cls, several: Sequence[Entries]) -> Entries:
        """The entries of all of these, one after the other."""
        return cls(torch.cat([entries.key for entries in several]), torch.cat([entries.value for entries in several]))

    def merged(self) -> Entries:
        """The same values with each key once, ascending."""
        runs = Runs.of(self.key)
        return Entries(runs.key, segment_sums(self.value[runs.order], runs.length))


def segment_sums(values: Float[Tensor, "rows ..."], length: Int[Tensor, " segments"]) -> Float[Tensor, "segments ..."]:
    """The sum of each segment: the first `length[0]` rows, the next `length[1]`, and so on."""
    if not len(values):
        return values.new_zeros(len(length), *values.shape[1:])
    return torch.segment_reduce(values, "sum", lengths=length, unsafe=True)
