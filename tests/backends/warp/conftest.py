"""The renderer under test, on the CPU and, where available, on CUDA. Its kernels are compiled once."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest

pytest.importorskip("warp", reason="the warp renderer needs warp-lang")

import torch
from svbrdfgan_warp import WarpRenderer

from svbrdfgan.types import Gradients, Rendering, TransportSamples

DEVICES = ("cpu", "cuda") if torch.cuda.is_available() else ("cpu",)


class ComparedOnCpu(WarpRenderer):
    """The renderer, with its results moved to the CPU, where the expected values are."""

    def render(self, *args: Any, **kwargs: Any) -> Rendering:
        rendering = super().render(*args, **kwargs)
        return Rendering(rendering.image.cpu(), rendering.coverage.cpu())

    def render_vjp(self, *args: Any, **kwargs: Any) -> Gradients:
        gradients = super().render_vjp(*args, **kwargs)
        maps = tuple({name: gradient.cpu() for name, gradient in part.items()} for part in gradients.materials)
        return Gradients(maps, None if gradients.environment is None else gradients.environment.cpu())

    def transport(self, *args: Any, **kwargs: Any) -> Iterator[TransportSamples]:
        chunks = super().transport(*args, **kwargs)
        return (replace(chunk, **{name: value.cpu() for name, value in vars(chunk).items()}) for chunk in chunks)


@pytest.fixture(scope="session", params=DEVICES)
def device(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="session")
def renderer(device: str) -> WarpRenderer:
    return ComparedOnCpu(device)
