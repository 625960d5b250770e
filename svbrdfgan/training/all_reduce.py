"""Gradient all-reduce: the mean over processes, computed while the backward pass still runs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import accumulate

import torch
import torch.distributed as dist
from torch import Tensor, nn

BUCKET_BYTES = 4 * 2**20
_ALIGNMENT = 64  # in values; kernels read faster from addresses that are multiples of 16 bytes


class GradientAllReduce:
    """The mean over processes of a network's gradients.

    Hooks compute it, since penalties differentiate twice, which `DistributedDataParallel` does not support. The first
    bucket holds the last parameters, whose gradients are ready first. A bucket is sent when it and all buckets before
    it are complete, so that every process sends the same buckets in the same order. One process has no hooks.

    Args:
        processes: size of the default process group. Every process must run the same backward passes.
        bucket_bytes: least size of a bucket.
    """

    def __init__(self, network: nn.Module, processes: int, bucket_bytes: int = BUCKET_BYTES) -> None:
        groups = _groups([p for p in network.parameters() if p.requires_grad], bucket_bytes) if processes > 1 else ()
        self._buckets = [_Bucket(group, processes) for group in groups]
        self._missing = [len(bucket.parameters) for bucket in self._buckets]
        self._sent: list[dist.Work] = []
        for number, bucket in enumerate(self._buckets):
            for parameter in bucket.parameters:
                parameter.register_post_accumulate_grad_hook(partial(self._arrive, number))

    def finish(self) -> None:
        """Waits for the means after a backward pass. Gradients that the pass did not compute stay None."""
        for bucket in self._buckets[len(self._sent) :]:
            self._sent.append(bucket.send())
        for work in self._sent:
            work.wait()
        self._sent.clear()
        self._missing = [len(bucket.parameters) for bucket in self._buckets]

    def _arrive(self, number: int, _: Tensor) -> None:
        self._missing[number] -= 1
        while len(self._sent) < len(self._buckets) and not self._missing[len(self._sent)]:
            self._sent.append(self._buckets[len(self._sent)].send())


class _Bucket:
    """A flat buffer for gradients, each strided as its parameter, which fused optimizers need."""

    def __init__(self, parameters: Sequence[nn.Parameter], processes: int) -> None:
        self.parameters, self._processes = parameters, processes
        sizes = (-(-p.numel() // _ALIGNMENT) * _ALIGNMENT for p in parameters)
        *starts, total = accumulate(sizes, initial=0)
        self._flat = torch.zeros(total, dtype=parameters[0].dtype, device=parameters[0].device)
        places = zip(parameters, starts, strict=True)
        self._views = [self._flat.as_strided(p.shape, p.stride(), start) for p, start in places]

    def send(self) -> dist.Work:
        """Starts the all-reduce, and makes the gradients views of its buffer."""
        views, gradients = [], []
        for parameter, view in zip(self.parameters, self._views, strict=True):
            if parameter.grad is None:
                view.zero_()
                continue
            views.append(view)
            gradients.append(parameter.grad)
            parameter.grad = view
        if views:
            torch._foreach_copy_(views, gradients)
        self._flat.div_(self._processes)
        return dist.all_reduce(self._flat, async_op=True)  # Fabric's all_reduce has a barrier, which waits for the GPU


def _groups(parameters: Sequence[nn.Parameter], least_bytes: int) -> Iterator[list[nn.Parameter]]:
    """The parameters from last to first, in groups of at least `least_bytes` but for the last group."""
    group: list[nn.Parameter] = []
    for parameter in reversed(parameters):
        group.append(parameter)
        if sum(p.nbytes for p in group) >= least_bytes:
            yield group
            group = []
    if group:
        yield group
