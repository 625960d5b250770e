"""Stored scenes in memory, within a budget; and the prefetching of light transports from files."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator, MutableMapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, Protocol, TypeVar

import torch

from svbrdfgan.rendering.transport.light_transport import LightTransport
from svbrdfgan.utils.devices import device_bytes

_SHARE = 0.25
"""The default budget is this share of the memory: the networks and their activations need the rest."""
_THREADS = 4


class _Stored(Protocol):
    @property
    def nbytes(self) -> int: ...

    @property
    def device(self) -> torch.device: ...


Key = TypeVar("Key")
Stored = TypeVar("Stored", bound=_Stored)


class MemoryCache(MutableMapping[Key, Stored], Generic[Key, Stored]):
    """Stored scenes, by key, within a budget of bytes. The least recently used are dropped first."""

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


@dataclass(frozen=True, eq=False)
class PendingTransport:
    """A transport that is being read from its file."""

    _future: Future[tuple[LightTransport, torch.cuda.Event | None]]

    def result(self) -> LightTransport:
        """The transport, for use on the current stream. The stream waits for the copy, the caller only for the file.

        Raises:
            AssetError: the file is missing, damaged, or not a light transport.
        """
        transport, copied = self._future.result()
        if copied is not None:
            stream = torch.cuda.current_stream(transport.texel.device)
            stream.wait_event(copied)
            transport.record_stream(stream)  # its memory belongs to the reader's stream and could be reused too early
        return transport


class TransportReader:
    """Reads transports from files to a device, on threads and, on CUDA, on a stream of its own."""

    def __init__(self, device: torch.device) -> None:
        self._device = device
        self._threads = ThreadPoolExecutor(_THREADS, thread_name_prefix="transports")
        self._stream = torch.cuda.Stream(device) if device.type == "cuda" else None

    def read(self, path: Path) -> PendingTransport:
        """Starts to read what `LightTransport.save` wrote, and returns at once."""
        return PendingTransport(self._threads.submit(self._read, path))

    def _read(self, path: Path) -> tuple[LightTransport, torch.cuda.Event | None]:
        transport = LightTransport.load(path)
        if self._stream is None:
            return transport.to(self._device), None
        with torch.cuda.stream(self._stream):
            return transport.to(self._device), self._stream.record_event()


class TransportStore(Generic[Key]):
    """Light transports of scenes, by key, on a device: those used last in memory, all others in their files.

    Prefetched transports do not count towards the memory budget. The budget should hold at least two batches, so that
    one batch does not evict what the next one needs too.

    Args:
        budget: see `MemoryCache`.
    """

    def __init__(self, device: torch.device, budget: int | None = None) -> None:
        self._device, self._reader = device, TransportReader(device)
        self.held: MemoryCache[Key, LightTransport] = MemoryCache(budget)
        self._pending: dict[Key, PendingTransport] = {}
        self._paths: dict[Key, Path] = {}

    def get(self, key: Key, file: Callable[[Key], Path]) -> LightTransport:
        """The transport of a scene.

        Args:
            file: returns its file, and is called once for each key; it makes the file if there is none.

        Raises:
            AssetError: the file is damaged, or not a light transport.
        """
        found = self.held.get(key)
        if found is None:
            pending = self._pending.pop(key, None)
            found = self._load(key, file) if pending is None else pending.result()
            self.held[key] = found
        return found

    def prefetch(self, key: Key) -> None:
        """Starts to read a transport that `get` will be asked for. Nothing happens if its file is not known yet."""
        if key in self._paths and key not in self._pending and self.held.get(key) is None:
            self._pending[key] = self._reader.read(self._paths[key])

    def _load(self, key: Key, file: Callable[[Key], Path]) -> LightTransport:
        if key not in self._paths:
            self._paths[key] = file(key)
        return LightTransport.load(self._paths[key]).to(self._device)
