"""Seconds and peak memory of steps, by one rule for every device and library."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar

import torch

from svbrdfgan.bench.memory import PeakMemory, release, used_bytes

Result = TypeVar("Result")

_SAMPLE_SECONDS = 0.02
"""A sample lasts about so long: of shorter work it is many calls in a row, as in a loop that waits for none of them."""
_STEP_SECONDS = 3.0
"""After so long no further sample is begun."""
_MOST_CALLS = 1000


@dataclass
class Meter:
    """What was measured on a device so far, by the step's name.

    Attributes:
        repeats: samples behind each median.
        seconds: median of one call, after one that does not count.
        peak_bytes: the most memory in use during the call that does not count, above what was in use at the start;
            so what an earlier step keeps, later ones have too.
        torch_bytes: of that, what torch's allocator gave out, on a GPU.
    """

    device: torch.device
    repeats: int
    seconds: dict[str, float] = field(default_factory=dict)
    peak_bytes: dict[str, int] = field(default_factory=dict)
    torch_bytes: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.start()

    def start(self, kept: int = 0) -> None:
        """From now on memory counts from here; the bytes that are `kept` of what there is count as well."""
        self._kept = kept
        release(self.device)
        if self.device.type == "cuda":
            self._torch_level = torch.cuda.memory_allocated(self.device) - kept
        self._level = used_bytes(self.device) - kept

    def step(self, name: str, action: Callable[[], Result]) -> Result:
        """Measures, and gives the result of the first call."""
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
    """Of one call, over `repeats` samples, or fewer where they take more than three seconds."""
    start = time.perf_counter()
    first = _sample(action, device, 1)
    calls = min(_MOST_CALLS, int(_SAMPLE_SECONDS / max(first, 1e-9)))
    samples = [] if calls > 1 else [first]
    while len(samples) < repeats and (not samples or time.perf_counter() - start < _STEP_SECONDS):
        samples.append(_sample(action, device, max(1, calls)))
    return statistics.median(samples)


def _sample(action: Callable[[], object], device: torch.device, calls: int) -> float:
    """Mean seconds of so many calls in a row; on a GPU by CUDA events.

    Warp and Dr.Jit may work in streams of their own, so the whole device is waited for before the second event.
    """
    wait(device)
    if device.type != "cuda":
        start = time.perf_counter()
        for _ in range(calls):
            action()
        return (time.perf_counter() - start) / calls
    before, after = (torch.cuda.Event(enable_timing=True) for _ in range(2))
    before.record()
    for _ in range(calls):
        action()
    wait(device)
    after.record()
    after.synchronize()
    return before.elapsed_time(after) / 1e3 / calls


def wait(device: torch.device) -> None:
    """Until all that the device was given, in whatever stream, is done."""
    if device.type == "cuda":
        torch.cuda.synchronize(device)
