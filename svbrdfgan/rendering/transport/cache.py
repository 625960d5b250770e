"""Light transports of many scenes: some in memory, the others prefetched from files."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

import torch

from svbrdfgan.rendering.transport.light_transport import LightTransport
from svbrdfgan.utils.memory_cache import MemoryCache

_THREADS = 4

Key = TypeVar("Key")


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
