"""The choice of a device, and launches on it that leave the caller's Warp and torch as they are."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from functools import lru_cache
from itertools import chain, islice
from typing import Any, TypeVar

import torch
import warp as wp
from torch import Tensor

from svbrdfgan.errors import ConfigError

_BLOCK = 128
"""Threads in a block. With 256 or more, tracing took a tenth longer on an H200."""

_PINNED = 2**20
"""Most bytes that are copied by pinned memory."""

Item = TypeVar("Item")
Result = TypeVar("Result")


@contextmanager
def quiet() -> Iterator[None]:
    """Suppresses Warp's banner and compiler messages; warnings are still shown."""
    level = wp.config.log_level
    wp.config.log_level = max(level, wp.LOG_WARNING)
    try:
        yield
    finally:
        wp.config.log_level = level


def choose_device(name: str) -> torch.device:
    """The torch device that `name` ("auto", "cpu", "cuda" or "cuda:N") means; "auto" prefers CUDA.

    Raises:
        ConfigError: another name, or a CUDA device that torch or Warp does not find.
    """
    if not re.fullmatch(r"auto|cpu|cuda(:\d+)?", name):
        raise ConfigError(f"warp renderer: device is {name!r}; wanted 'auto', 'cpu', 'cuda' or 'cuda:N'.")
    with quiet():
        wp.init()
        count = min(torch.cuda.device_count(), wp.get_cuda_device_count())
    if name == "cpu" or (name == "auto" and count == 0):
        return torch.device("cpu")
    index = int(name[5:]) if ":" in name else torch.cuda.current_device() if count else 0
    if index >= count:
        raise ConfigError(
            f"warp renderer: device is {name!r}, but torch and Warp find {count} CUDA devices; choose 'cpu' or 'auto'."
        )
    return torch.device("cuda", index)


def stream(device: torch.device) -> wp.Stream | None:
    """The current CUDA stream of torch; None on the CPU."""
    return _stream(torch.cuda.current_stream(device)) if device.type == "cuda" else None


@lru_cache(maxsize=16)
def _stream(current: torch.cuda.Stream) -> wp.Stream:
    return wp.stream_from_torch(current)


def finish(device: torch.device) -> None:
    """Waits for CUDA: a later caller may use what was made in another stream."""
    if device.type == "cuda":
        torch.cuda.synchronize(device)


def upload(tensor: Tensor, device: torch.device) -> Tensor:
    """The tensor on the device. The caller does not wait for a copy to CUDA if it is small.

    Such a copy goes by pinned memory, which torch keeps, in torch's current stream.
    """
    if device.type == "cuda" and tensor.device.type == "cpu" and tensor.nbytes <= _PINNED:
        return tensor.pin_memory().to(device, non_blocking=True)
    return tensor.to(device)


def argument(tensor: Tensor, dtype: Any = None) -> Any:
    """The tensor as kernels take it, but not structs: faster than an array, since Warp does not check it again."""
    return wp.from_torch(tensor, dtype, return_ctype=True)


def launch(kernel: wp.Kernel, threads: int | tuple[int, int], arguments: Sequence[Any], device: torch.device) -> None:
    """Runs a kernel in torch's current stream, unrecorded by any tape of the caller's."""
    where = wp.device_from_torch(device)
    wp.launch(
        kernel, threads, list(arguments), device=where, stream=stream(device), record_tape=False, block_dim=_BLOCK
    )


def in_order(job: Callable[[Item], Result], items: Iterable[Item], device: torch.device) -> Iterator[Result]:
    """The results of `job`, in the order of `items`.

    A Warp launch on the CPU runs on one thread. So there as many jobs run at once as torch has threads, and results are
    prepared a few items ahead of the caller, which bounds the memory.
    """
    workers, rest = torch.get_num_threads() if device.type == "cpu" else 1, iter(items)
    first = list(islice(rest, 2))
    if workers == 1 or len(first) < 2:
        yield from map(job, chain(first, rest))
        return
    with ThreadPoolExecutor(workers) as pool:
        ahead: list[Future[Result]] = []
        for item in chain(first, rest):
            ahead.append(pool.submit(job, item))
            if len(ahead) > 2 * workers:
                yield ahead.pop(0).result()
        while ahead:
            yield ahead.pop(0).result()
