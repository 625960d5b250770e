"""Where a picture and its gradient spend their time: the whole call, Python's share of it, and the kernels by `warp`.

    python benchmarks/profile_rendering.py [SPP] [VERTICES]

On the standard scene of `svbrdfgan bench`, through autograd; by default with 200 samples and a million vertices.
Python's share is the time until the last call returns. A function that does nothing shows what autograd takes.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor
from torch.profiler import profile

from svbrdfgan import load_renderer
from svbrdfgan.bench.meter import wait
from svbrdfgan.bench.standard_scenes import glossy_scene, standard_scene
from svbrdfgan.rendering.render_layer import RenderLayer

_SERIES, _CALLS = 5, 20


class _Nothing(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, texels: Tensor) -> Tensor:
        ctx.save_for_backward(texels)
        return texels

    @staticmethod
    def backward(ctx: Any, grad: Tensor) -> Tensor:
        return ctx.saved_tensors[0]


def main(spp: int = 200, vertices: int = 1_000_000) -> None:
    renderer, scene = load_renderer("warp"), standard_scene(vertices)
    prepared, view, layer = renderer.prepare(scene.surface()), scene.view(), RenderLayer(renderer, spp)
    for name, shown in (("base colour", scene), ("whole material", glossy_scene(scene))):
        textures = {key: values.requires_grad_() for key, values in shown.textures(renderer.device).items()}

        def picture(seed: int, shown: Any = shown, textures: dict[str, Tensor] = textures) -> None:
            image = layer(prepared, shown.materials(textures), view, seed=seed).image
            torch.autograd.grad(image.square().mean(), list(textures.values()))

        _time(f"{name}, {spp} samples", picture, renderer.device)
        _list_kernels(picture, renderer.device)
    texels = scene.textures(renderer.device)["base_color"].requires_grad_()
    _time("nothing", lambda _: torch.autograd.grad(_Nothing.apply(texels).square().mean(), texels), renderer.device)


def _time(name: str, call: Callable[[int], object], device: torch.device) -> None:
    """Prints the median time of a call, and until it returns; the first series warms up."""
    series = []
    for number in range(_SERIES + 1):
        wait(device)
        began = time.perf_counter()
        for seed in range(_CALLS):
            call(seed + _CALLS * number)
        returned = time.perf_counter() - began
        wait(device)
        series.append((time.perf_counter() - began, returned))
    whole, python = (1e3 * statistics.median(times) / _CALLS for times in zip(*series[1:], strict=True))
    print(f"{name}: {whole:.3f} ms, Python {python:.3f}", flush=True)


def _list_kernels(call: Callable[[int], object], device: torch.device) -> None:
    """Prints the milliseconds of each kernel by Warp in a call, on a GPU: elsewhere they are not known."""
    with profile() as profiled:
        for seed in range(_CALLS):
            call(seed)
        wait(device)
    for event in profiled.key_averages():
        name, mark, _ = event.key.partition("_cuda_kernel_forward")
        if mark:
            print(f"    {name.rpartition('_')[0]}: {event.self_device_time_total / 1e3 / _CALLS:.3f} ms", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
