"""Merge equal rows of an array; used to weld vertices and to split corners."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray


def merge_rows(rows: Float[ndarray, "rows columns"]) -> tuple[Float[ndarray, "merged columns"], Int[ndarray, " rows"]]:
    """The distinct rows, in order of first appearance, and the index of each row among them. -0 equals 0."""
    rows = rows + 0.0  # -0.0 + 0.0 is 0.0
    order = np.lexsort(rows.T)
    fresh = np.any(np.diff(rows[order], axis=0, prepend=np.nan) != 0.0, axis=1)
    first = np.minimum.reduceat(order, np.flatnonzero(fresh))
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    index = np.empty(len(rows), dtype=np.int64)
    index[order] = rank[np.cumsum(fresh) - 1]
    return rows[np.sort(first)], index


def members(owner: Int[ndarray, " rows"], count: int) -> list[Int[ndarray, " members"]]:
    """The rows of each of `count` owners, in order; all together as long as `owner`, so that loops over owners are."""
    order = np.argsort(owner, kind="stable")
    return np.split(order, np.searchsorted(owner[order], np.arange(1, count)))
