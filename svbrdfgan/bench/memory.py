"""How much memory a piece of work takes at its peak, whoever allocates it."""

from __future__ import annotations

import ctypes
import gc
import os
from contextlib import suppress
from pathlib import Path
from threading import Event, Thread
from types import TracebackType

import torch

_PAGES = Path("/proc/self/statm")
_EVERY_SECONDS = 0.002


def used_bytes(device: torch.device) -> int:
    """What is taken of a GPU's memory, by every library and every process; on the CPU, what this process holds of it.

    Zero where the system does not say: on the CPU it is read from Linux's /proc.
    """
    if device.type == "cuda":
        free, total = torch.cuda.mem_get_info(device)
        return total - free
    try:
        return int(_PAGES.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return 0


def release(device: torch.device) -> None:
    """Gives back what is free but kept by allocators, so that using it anew shows: torch's on a GPU, else glibc's."""
    gc.collect()
    if device.type == "cuda":
        torch.cuda.synchronize(device)
        torch.cuda.empty_cache()
    with suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)


class PeakMemory:
    """Looks every two milliseconds, in a thread of its own, for as long as the `with` block lasts.

    Attributes:
        bytes: the most that was seen so far.
    """

    def __init__(self, device: torch.device) -> None:
        self._device, self._over = device, Event()
        self._thread = Thread(target=self._watch, daemon=True)
        self.bytes = 0

    def look(self) -> None:
        """Looks now: after work that was shorter than two milliseconds, before its memory is given back."""
        self.bytes = max(self.bytes, used_bytes(self._device))

    def __enter__(self) -> PeakMemory:
        self.look()
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._over.set()
        self._thread.join()
        self.look()

    def _watch(self) -> None:
        while not self._over.wait(_EVERY_SECONDS):
            self.look()
