"""Where a picture and its gradient spend their time on a GPU: whole calls, Python's share of them, and kernels.

    python benchmarks/profile_rendering.py [SPP]...

On the standard scene of `svbrdfgan bench`, by `warp`, through autograd. Python's share is the time until the last call
returns. The last row of whole calls is a function that does nothing, which shows what autograd takes.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable, Mapping
from typing import Any

import torch
from torch import Tensor
from torch.profiler import ProfilerActivity, profile

from svbrdfgan import load_renderer
from svbrdfgan.bench.bench_scene import BenchScene
from svbrdfgan.bench.standard_scenes import glossy_scene, standard_scene
from svbrdfgan.bench.time_renderer import transport_of
from svbrdfgan.rendering.render_layer import RenderLayer
from svbrdfgan.rendering.shade_layer import shade
from svbrdfgan.rendering.transport.product import TransportBatch

_SERIES, _CALLS = 5, 50


def main() -> None:
    renderer, scene = load_renderer("warp"), standard_scene()
    prepared, view, device = renderer.prepare(scene.surface()), scene.view(), renderer.device

    def picture(shown: BenchScene, textures: Mapping[str, Tensor], spp: int) -> Callable[[int], object]:
        def call(seed: int) -> object:
            image = RenderLayer(renderer, spp)(prepared, shown.materials(textures), view, seed=seed).image
            return torch.autograd.grad(image.square().mean(), list(textures.values()))

        return call

    numbers = [int(argument) for argument in sys.argv[1:]] or [16, 200]
    for name, shown in (("base colour", scene), ("whole material", glossy_scene(scene))):
        textures = _leaves(shown.textures(device))
        for spp in numbers:
            _time(f"{name}, {spp} samples", picture(shown, textures, spp))
            _list_kernels(picture(shown, textures, spp))
        if shown.gloss.size:
            light = renderer.store_light(prepared, view, learnable=(0,), hits=numbers[0], spp=numbers[0], seed=0)
            values = torch.cat([each.detach() for each in textures.values()], dim=-1)[None].requires_grad_()

            def stored(seed: int) -> object:
                maps = tuple(textures)  # noqa: B023
                image = shade(renderer, [light], values, maps=maps, visit=seed, seed=seed)  # noqa: B023
                return torch.autograd.grad(image.square().mean(), values)  # noqa: B023

            _time(f"{name}, stored light, {numbers[0]} samples", stored)
    batch = TransportBatch.stack([transport_of(renderer, prepared, scene, view, numbers[0])])
    texels = scene.textures(device)["base_color"][None].requires_grad_()
    image, gradient = batch.render(texels).detach(), torch.zeros_like(texels)

    class Nothing(torch.autograd.Function):
        @staticmethod
        def forward(ctx: Any, texels: Tensor) -> Tensor:
            return image

        @staticmethod
        def backward(ctx: Any, grad: Tensor) -> Tensor:
            return gradient

    _time("stored product", lambda _: torch.autograd.grad(batch.render(texels).square().mean(), texels))
    _time("nothing", lambda _: torch.autograd.grad(Nothing.apply(texels).square().mean(), texels))


def _leaves(textures: Mapping[str, Tensor]) -> dict[str, Tensor]:
    return {name: values.requires_grad_() for name, values in textures.items()}


def _time(name: str, call: Callable[[int], object]) -> None:
    """Prints the median time of a call, and until it returns."""
    series = []
    for number in range(_SERIES + 1):
        torch.cuda.synchronize()
        began = time.perf_counter()
        for seed in range(_CALLS):
            call(seed + _CALLS * number)
        returned = time.perf_counter() - began
        torch.cuda.synchronize()
        series.append((time.perf_counter() - began, returned))
    whole, python = (1e3 * statistics.median(times) / _CALLS for times in zip(*series[1:], strict=True))
    print(f"{name}: {whole:.3f} ms, Python {python:.3f}", flush=True)


def _list_kernels(call: Callable[[int], object], calls: int = 10) -> None:
    """Prints the milliseconds of a call's kernels by Warp."""
    with profile(activities=[ProfilerActivity.CPU, ProfilerActivity.CUDA]) as profiled:
        for seed in range(calls):
            call(seed)
        torch.cuda.synchronize()
    for event in profiled.key_averages():
        name, mark, _ = event.key.partition("_cuda_kernel_forward")
        if mark:
            print(f"    {name.rpartition('_')[0]}: {event.self_device_time_total / 1e3 / calls:.3f} ms", flush=True)


if __name__ == "__main__":
    main()
