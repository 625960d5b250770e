"""Launches of the noise kernels on CPU and CUDA; arguments and results are those of `noise_reference`, as tensors."""

# mypy: ignore-errors

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from typing import Any

import torch
import warp as wp
from torch import Tensor

from svbrdfgan.utils.threads import in_threads
from svbrdfgan.weathering import cell_kernels, fbm_kernels
from svbrdfgan.weathering.lattice_hash import DIRECTIONS, stream
from svbrdfgan.weathering.noise_reference import NUMBERS, SCRATCHES, SPOTS, STREAKS, octave_weights

BLOCK = 32768
"""Points of one launch on the CPU, where Warp has one thread: enough that a launch's own time is small beside it."""

_TYPES = {1: wp.float32, 2: wp.vec2, 3: wp.vec3, 4: wp.vec4}
_loading = threading.Lock()


def fbm(points: Tensor, seed: int, octaves: float, gain: float, slope: bool) -> tuple[Tensor, ...]:
    weights = octave_weights(octaves, gain)
    scale = 1.0 / sum(weights)
    kernel = fbm_kernels.fbm_and_slope if slope else fbm_kernels.fbm
    options = (_directions(points.device), stream(seed * NUMBERS), len(weights), gain, weights[-1] * scale, scale)
    return _launched(kernel, (points,), options, (1, 3) if slope else (1,))


def spots(points: Tensor, share: Tensor, seed: int, slope: bool) -> tuple[Tensor, ...]:
    kernel = cell_kernels.spots_and_slope if slope else cell_kernels.spots
    return _launched(kernel, (points, share), (stream(seed * NUMBERS + SPOTS),), (1, 4, 3) if slope else (1, 4))


def streaks(plane: Tensor, share: Tensor, seed: int) -> tuple[Tensor, ...]:
    return _launched(cell_kernels.streaks, (plane, share), (stream(seed * NUMBERS + STREAKS),), (1, 1, 2, 4))


def scratches(points: Tensor, normal: Tensor, share: Tensor, seed: int) -> tuple[Tensor, ...]:
    options = (stream(seed * NUMBERS + SCRATCHES),)
    return _launched(cell_kernels.scratches, (points, normal, share), options, (1, 1, 1, 4))


def _launched(
    kernel: wp.Kernel, inputs: Sequence[Tensor], options: Sequence[Any], widths: Sequence[int]
) -> tuple[Tensor, ...]:
    """The kernel's outputs, of these widths; on the CPU it runs on as many threads as torch has."""
    count, device = len(inputs[0]), inputs[0].device
    outputs = tuple(inputs[0].new_empty((count, width) if width > 1 else count) for width in widths)
    where, on_cpu = wp.device_from_torch(device), device.type == "cpu"
    queue = None if on_cpu else wp.stream_from_torch(torch.cuda.current_stream(device))

    def launch(start: int) -> None:
        taken, made = ([_array(tensor[start : start + step]) for tensor in each] for each in (inputs, outputs))
        wp.launch(kernel, len(taken[0]), [*taken, *options, *made], device=where, stream=queue, record_tape=False)

    with _loading, _quiet():
        wp.load_module(kernel.module, where)  # compiled once, before there are threads
    step = BLOCK if on_cpu else max(count, 1)
    starts = range(0, count, step)
    for _ in in_threads(launch, starts) if on_cpu else map(launch, starts):
        pass
    return outputs


@contextmanager
def _quiet() -> Iterator[None]:
    """Suppresses Warp's banner and compiler messages; warnings are still shown."""
    level = wp.config.log_level
    wp.config.log_level = max(level, wp.LOG_WARNING)
    try:
        yield
    finally:
        wp.config.log_level = level


def _array(tensor: Tensor) -> wp.array:
    return wp.from_torch(tensor, dtype=_TYPES[tensor.shape[1] if tensor.ndim == 2 else 1])


@cache
def _directions(device: torch.device) -> wp.array:
    return _array(torch.from_numpy(DIRECTIONS.T).to(device, torch.float32).contiguous())


with _quiet():
    wp.init()
