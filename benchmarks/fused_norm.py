"""The fused norm, activation and padding of the generator: our Triton kernels against `torch.compile` and eager torch.

    python benchmarks/fused_norm.py                         # the thesis's sizes, on CUDA if there is any
    python benchmarks/fused_norm.py --device cpu --batch 2  # what a CPU can say

Each case is one place in the generator (`svbrdfgan/networks/generator.py`), channels-last, in float32 and under bf16
autocast. Four implementations of the same operation are compared:

- `reference`: `norm_act_pad_reference`, by eager torch.
- `compiled`: the reference under `torch.compile`, for fixed shapes. The result has the reference's memory layout, which
  torch's instance norm makes rows-first, so that the next convolution has to copy.
- `compiled formula`: `torch.compile` of the norm written as a formula, which stays channels-last.
- `kernels`: `norm_act_pad_triton`, which need CUDA and Triton.

Columns:

- `first`: seconds of the first forward and backward pass, in which kernels are compiled or autotuned.
- `forward`, `both`: milliseconds of the forward pass, and of forward and gradient: medians by `torch.utils.benchmark`,
  which waits for the GPU. The gradient is that of `x` and the residual, or of all parameters of a generator.
- `twice`: milliseconds of forward, gradient and the gradient of the squared gradient, as a gradient penalty needs it;
  or why that fails. The generator needs first derivatives alone; its discriminators do not use this operation.
- `saved`: MiB that autograd keeps between forward and backward. `peak`: MiB that both passes allocate (CUDA alone).
- `error`: of the result and the gradient of `x` against the reference in float64, relative to the greatest value.

The last cases are whole generators, where `compiled whole` is `torch.compile` of the module with the reference inside.

On an H100 (torch 2.11, bf16, batch 16, 256x256, width 64) a generator's forward pass and gradient take 16.2 ms with
our kernels, 33.5 with the best compiled norm, 38.2 with the whole network compiled and 48.2 by eager torch; the forward
pass alone takes 5.4, 10.1, 5.5 and 17.4. Compiled code loses most where padding or upsampling follows the norm, and it
refuses second derivatives ("torch.compile with aot_autograd does not currently support double backward"), on a CPU too.
Errors are alike. So the kernels stay.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from unittest import mock

import click
import torch
from rich.console import Console
from rich.table import Table
from torch import Tensor
from torch.utils.benchmark import Timer

from svbrdfgan.networks.fused import Features, NormActPad
from svbrdfgan.networks.fused.reference import norm_act_pad_reference
from svbrdfgan.networks.generator import Generator
from svbrdfgan.networks.layers import EPSILON, initialise
from svbrdfgan.utils.triton_works import triton_works

Operation = Callable[[], tuple[Tensor, list[Tensor]]]
"""Runs forward; returns the result and the inputs to differentiate in."""
DTYPES = {"float32": torch.float32, "bf16": torch.bfloat16}
MIB = 2**20


@dataclass(frozen=True)
class Case:
    """A place in the generator: `channels` and `size` are multiples of the width and parts of the picture's side."""

    name: str
    channels: int
    reduction: int
    spec: NormActPad
    residual: bool = False


CASES = (
    Case("first strided convolution", 1, 1, NormActPad(norm=True, relu=True, pad=1)),
    Case("inside a block", 4, 4, NormActPad(norm=True, relu=True, pad=1)),
    Case("between blocks", 4, 4, NormActPad(norm=True, pad=1), residual=True),
    Case("second upsampling", 2, 2, NormActPad(norm=True, relu=True, upsample=2, pad=1)),
    Case("last convolution", 1, 1, NormActPad(norm=True, relu=True, pad=3)),
)


@dataclass(frozen=True)
class Setting:
    """The conditions that all measurements share."""

    device: torch.device
    dtype: torch.dtype
    batch: int
    size: int
    width: int
    seconds: float

    def autocast(self) -> AbstractContextManager[object]:
        return torch.autocast(self.device.type, torch.bfloat16, enabled=self.dtype == torch.bfloat16)

    def values(self, *shape: int, seed: int) -> Tensor:
        made = torch.randn(shape, generator=torch.Generator().manual_seed(seed)).to(self.device, self.dtype)
        return made.contiguous(memory_format=torch.channels_last)


@click.command()
@click.option("--device", default="cuda" if torch.cuda.is_available() else "cpu", show_default=True)
@click.option("--dtype", type=click.Choice(list(DTYPES)), multiple=True, default=list(DTYPES), show_default=True)
@click.option("--batch", default=16, show_default=True)
@click.option("--size", default=256, show_default=True, help="Rows and columns of the picture.")
@click.option("--width", default=64, show_default=True, help="Channels after the generator's first convolution.")
@click.option("--seconds", default=1.0, show_default=True, help="Least time of each measurement.")
@click.option("--generators/--no-generators", default=True, show_default=True, help="Measure whole generators too.")
def main(
    device: str, dtype: tuple[str, ...], batch: int, size: int, width: int, seconds: float, generators: bool
) -> None:
    """Prints a table for each precision."""
    console = Console(width=None if sys.stdout.isatty() else 220)  # in a file no cell is cut
    console.print(f"torch {torch.__version__}, {_device_name(device)}, batch {batch}, {size}x{size}, width {width}")
    for name in dtype:
        setting = Setting(torch.device(device), DTYPES[name], batch, size, width, seconds)
        columns = ("first s", "forward ms", "both ms", "twice ms", "saved MiB", "peak MiB", "error")
        table = Table("case", "implementation", *columns, title=name)
        for row in _rows(setting, generators):
            table.add_row(*row)
            console.print(" · ".join(row), style="dim")  # at once, since compiling takes minutes
        console.print(table)


def _rows(setting: Setting, generators: bool) -> Iterator[tuple[str, ...]]:
    for case in CASES:
        truth = _truth(case, setting)
        for name, implementation in _implementations(setting).items():
            yield case.name, name, *_measured(_operation(case, setting, implementation), setting, truth)
    for name, operation in _generators(setting) if generators else ():
        yield "generator", name, *_measured(operation, setting, None)


def _implementations(setting: Setting) -> dict[str, Callable[..., tuple[Tensor, Tensor]]]:
    torch._dynamo.reset()  # so that no case profits from another's compilation
    found: dict[str, Callable[..., tuple[Tensor, Tensor]]] = {
        "reference": norm_act_pad_reference,
        "compiled": torch.compile(norm_act_pad_reference, dynamic=False),
        "compiled formula": torch.compile(norm_act_pad_formula, dynamic=False),
    }
    if setting.device.type == "cuda" and triton_works(setting.device):
        from svbrdfgan.networks.fused.autograd import norm_act_pad_triton

        found["kernels"] = norm_act_pad_triton
    return found


def norm_act_pad_formula(x: Tensor, spec: NormActPad, residual: Tensor | None = None) -> Features:
    """`norm_act_pad_reference`, with a norm that keeps the layout in memory."""
    features = x
    if spec.norm:
        variance, mean = torch.var_mean(x.float(), dim=(2, 3), keepdim=True, correction=0)
        features = ((x.float() - mean) * torch.rsqrt(variance + EPSILON)).to(x.dtype)
    return norm_act_pad_reference(features, replace(spec, norm=False), residual)


def _inputs(case: Case, setting: Setting) -> list[Tensor]:
    side = setting.size // case.reduction
    shape = (setting.batch, case.channels * setting.width, side, side)
    return [setting.values(*shape, seed=seed).requires_grad_() for seed in range(2 if case.residual else 1)]


def _operation(case: Case, setting: Setting, implementation: Callable[..., tuple[Tensor, Tensor]]) -> Operation:
    inputs = _inputs(case, setting)

    def run() -> tuple[Tensor, list[Tensor]]:
        with setting.autocast():
            return implementation(inputs[0], case.spec, *inputs[1:])[0], inputs

    return run


def _truth(case: Case, setting: Setting) -> tuple[Tensor, Tensor]:
    """Result and gradient of x in float64."""
    inputs = [tensor.detach().double().requires_grad_() for tensor in _inputs(case, setting)]
    padded = norm_act_pad_reference(inputs[0], case.spec, *inputs[1:]).padded
    return padded.detach(), torch.autograd.grad(padded, inputs[0], _cotangent(padded, setting).double())[0]


def _generators(setting: Setting) -> Iterator[tuple[str, Operation]]:
    for name, implementation in _implementations(setting).items():
        yield name, _generator(setting, implementation)
    yield "compiled whole", _generator(setting, norm_act_pad_reference, whole=True)


def _generator(
    setting: Setting, implementation: Callable[..., tuple[Tensor, Tensor]], whole: bool = False
) -> Operation:
    """The generator with this implementation; parameters stay in float32, as in training."""
    network = Generator(width=setting.width)
    initialise(network, torch.Generator().manual_seed(0))
    network = network.to(setting.device, memory_format=torch.channels_last)  # type: ignore[call-overload]
    geometry = setting.values(setting.batch, 6, setting.size, setting.size, seed=0).float()
    called = torch.compile(network, dynamic=False) if whole else network

    def run() -> tuple[Tensor, list[Tensor]]:
        with setting.autocast(), mock.patch("svbrdfgan.networks.generator.norm_act_pad", implementation):
            return called(geometry), list(network.parameters())

    return run


def _measured(operation: Operation, setting: Setting, truth: tuple[Tensor, Tensor] | None) -> tuple[str, ...]:
    """The cells of a row."""
    cuda = setting.device.type == "cuda"
    began = time.perf_counter()
    _differentiate(*operation(), setting)
    first = time.perf_counter() - began
    if cuda:
        torch.cuda.synchronize()
        torch.cuda.reset_peak_memory_stats()
    before = torch.cuda.memory_allocated() if cuda else 0
    with _saved_bytes() as saved:
        result, inputs = operation()
    gradient = _differentiate(result, inputs, setting)[0]
    peak = f"{(torch.cuda.max_memory_allocated() - before) / MIB:.0f}" if cuda else "-"
    error = "-" if truth is None else f"{_error(result, truth[0]):.1e}, {_error(gradient, truth[1]):.1e}"
    forward = _milliseconds(operation, setting)
    both = _milliseconds(lambda: _differentiate(*operation(), setting), setting)
    cells = (f"{first:.1f}", f"{forward:.2f}", f"{both:.2f}", _twice(operation, setting), f"{saved() / MIB:.1f}")
    return *cells, peak, error


def _milliseconds(run: Callable[[], object], setting: Setting) -> float:
    timer = Timer("run()", globals={"run": run}, num_threads=torch.get_num_threads())
    return float(timer.blocked_autorange(min_run_time=setting.seconds).median) * 1e3


def _differentiate(result: Tensor, inputs: list[Tensor], setting: Setting) -> tuple[Tensor, ...]:
    return torch.autograd.grad(result, inputs, _cotangent(result, setting))


_COTANGENTS: dict[tuple[object, ...], Tensor] = {}


def _cotangent(result: Tensor, setting: Setting) -> Tensor:
    """A fixed gradient of the result, as it comes from a convolution: of the same type, channels-last."""
    key = (*result.shape, setting.dtype)
    if key not in _COTANGENTS:
        _COTANGENTS.clear()
        _COTANGENTS[key] = setting.values(*result.shape, seed=7)
    return _COTANGENTS[key].to(result.dtype)


def _twice(operation: Operation, setting: Setting) -> str:
    """Milliseconds of a gradient penalty, or why there is none."""

    def run() -> None:
        result, inputs = operation()
        gradients = torch.autograd.grad(result.float().square().sum(), inputs[:1], create_graph=True)
        torch.autograd.grad(gradients[0].float().square().sum(), inputs[:1])

    try:
        # by default compiled code reuses the memory of saved tensors, and refuses a second derivative for that reason
        # alone; without it, the message is that of AOTAutograd itself
        with torch._functorch.config.patch(donated_buffer=False):
            torch._dynamo.reset()
            run()
            return f"{_milliseconds(run, setting):.2f}"
    except RuntimeError as error:
        return str(error).splitlines()[0][:70]


@contextmanager
def _saved_bytes() -> Iterator[Callable[[], int]]:
    """Counts the bytes of the tensors that autograd saves in the block, each piece of memory once."""
    pieces: dict[int, int] = {}

    def pack(tensor: Tensor) -> Tensor:
        storage = tensor.untyped_storage()
        pieces[storage.data_ptr()] = storage.nbytes()
        return tensor

    with torch.autograd.graph.saved_tensors_hooks(pack, lambda tensor: tensor):
        yield lambda: sum(pieces.values())


def _error(found: Tensor, truth: Tensor) -> float:
    return float((found.detach().double() - truth).abs().max() / truth.abs().max())


def _device_name(device: str) -> str:
    return (
        torch.cuda.get_device_name(device)
        if torch.device(device).type == "cuda"
        else f"{device}, " + (f"{torch.get_num_threads()} threads")
    )


if __name__ == "__main__":
    main()
