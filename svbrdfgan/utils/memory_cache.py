"""Values in memory by key, within a budget: the least recently used are dropped first."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator, MutableMapping
from typing import Generic, Protocol, TypeVar

import torch

from svbrdfgan.utils.devices import device_bytes

_SHARE = 0.25
"""The default budget is this share of the memory: the networks and their activations need the rest."""


class _Stored(Protocol):
    @property
    def nbytes(self) -> int: ...

    @property
    def device(self) -> torch.device: ...


Key = TypeVar("Key")
Stored = TypeVar("Stored", bound=_Stored)


class MemoryCache(MutableMapping[Key, Stored], Generic[Key, Stored]):
    """Values, by key, within a budget of bytes. The least recently used are dropped first."""

    def __init__(self, budget: int | None = None, share: float = _SHARE) -> None:
        """An empty cache of `budget` bytes; None takes this share of the memory of the first value's device."""
        self._budget, self._share = budget, share
        self._held: OrderedDict[Key, Stored] = OrderedDict()
        self.nbytes = 0

    def __getitem__(self, key: Key) -> Stored:
        self._held.move_to_end(key)
        return self._held[key]

    def __setitem__(self, key: Key, stored: Stored) -> None:
        """Keeps the value; one that is larger than the budget is kept alone."""
        self.pop(key, None)
        self._held[key] = stored
        self.nbytes += stored.nbytes
        if self._budget is None:
            self._budget = int(device_bytes(stored.device) * self._share)
        while self.nbytes > self._budget and len(self._held) > 1:
            del self[next(iter(self._held))]

    def __delitem__(self, key: Key) -> None:
        self.nbytes -= self._held.pop(key).nbytes

    def __iter__(self) -> Iterator[Key]:
        return iter(list(self._held))  # a copy, since a look-up reorders the dictionary

    def __len__(self) -> int:
        return len(self._held)

    def __contains__(self, key: object) -> bool:
        return key in self._held
