"""Seconds and peak memory of steps, measured alike for every device and library."""

from __future__ import annotations

import ctypes
import gc
import os
import statistics
import time
import timeit
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from threading import Event, Thread
from types import TracebackType
from typing import TypeVar

import torch

Result = TypeVar("Result")

_SAMPLE_SECONDS = 0.02
"""The least length of a sample. One of shorter work is many calls in a row that are not waited for one by one."""
_STEP_SECONDS = 3.0
"""Time after which no further sample begins."""
_MOST_CALLS = 1000  # in a sample
_PAGES = Path("/proc/self/statm")  # its second number: resident pages of this process
_LOOK_EVERY_SECONDS = 0.002


@dataclass
class Meter:
    """Seconds and memory measured on a device so far, by the step's name.

    Attributes:
        repeats: samples behind each median.
        seconds: median of one call, after a first call that is not timed.
        peak_bytes: the most memory in use during that first call, above what was in use at the start. Memory that
            an earlier step keeps counts in later steps too.
        torch_bytes: the part of `peak_bytes` that torch's allocator gave out, on a GPU.
    """

    device: torch.device
    repeats: int
    seconds: dict[str, float] = field(default_factory=dict)
    peak_bytes: dict[str, int] = field(default_factory=dict)
    torch_bytes: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.start()

    def start(self, kept: int = 0) -> None:
        """Memory is measured from the present level on; `kept` bytes of what is in use now still count."""
        self._kept = kept
        release(self.device)
        if self.device.type == "cuda":
            self._torch_level = torch.cuda.memory_allocated(self.device) - kept
        self._level = used_bytes(self.device) - kept

    def step(self, name: str, action: Callable[[], Result]) -> Result:
        """The result of the first call. Measures it and further ones."""
        if self.device.type == "cuda":
            torch.cuda.reset_peak_memory_stats(self.device)
        with PeakMemory(self.device) as peak:
            result = action()
            peak.look()
            wait(self.device)
        if peak.bytes:
            self.peak_bytes[name] = max(self._kept, peak.bytes - self._level)
        if self.device.type == "cuda":
            self.torch_bytes[name] = torch.cuda.max_memory_allocated(self.device) - self._torch_level
        self.seconds[name] = median_seconds(action, self.device, self.repeats)
        return result


def median_seconds(action: Callable[[], object], device: torch.device, repeats: int) -> float:
    """The median of one call over `repeats` samples, or over fewer if they take more than three seconds."""
    # timeit would stop the garbage collector, so that pictures in reference cycles filled the memory
    timer = timeit.Timer(action, "import gc; gc.enable()", partial(_clock, device))
    start = time.perf_counter()
    first = timer.timeit(1)
    calls = min(_MOST_CALLS, int(_SAMPLE_SECONDS / max(first, 1e-9)))  # a call may take less than the clock's step
    samples = [] if calls > 1 else [first]
    while len(samples) < repeats and (not samples or time.perf_counter() - start < _STEP_SECONDS):
        samples.append(timer.timeit(max(1, calls)) / max(1, calls))
    return statistics.median(samples)


def _clock(device: torch.device) -> float:
    """Seconds, read once the device is idle."""
    wait(device)
    return time.perf_counter()


def wait(device: torch.device) -> None:
    """Returns when the device has done its work in all streams: Warp and Dr.Jit use streams of their own."""
    if device.type == "cuda":
        torch.cuda.synchronize(device)


def used_bytes(device: torch.device) -> int:
    """The memory in use: of a GPU, by all libraries and processes; of the CPU, by this process.

    The CPU's is read from /proc, which Linux has; elsewhere it is zero.
    """
    if device.type == "cuda":
        free, total = torch.cuda.mem_get_info(device)
        return total - free
    try:
        return int(_PAGES.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return 0


def release(device: torch.device) -> None:
    """Makes torch's and glibc's allocators return free memory to the system, so that its next use is seen."""
    gc.collect()
    if device.type == "cuda":
        torch.cuda.synchronize(device)
        torch.cuda.empty_cache()
    with suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)


class PeakMemory:
    """Measures the memory in use every two milliseconds, in a thread, during the `with` block.

    Attributes:
        bytes: the most in use so far.
    """

    def __init__(self, device: torch.device) -> None:
        self._device, self._over = device, Event()
        self._thread = Thread(target=self._watch, daemon=True)
        self.bytes = 0

    def look(self) -> None:
        """Measures now: call it after short work, before its memory is freed."""
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
        while not self._over.wait(_LOOK_EVERY_SECONDS):
            self.look()
