"""What became of each camera sample, traced in chunks of bounded memory."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
import warp as wp
from jaxtyping import Float, Int
from torch import Tensor

from svbrdfgan.types import TransportSamples, View
from svbrdfgan_warp import emitter, kernels
from svbrdfgan_warp.device import launch
from svbrdfgan_warp.scene import PreparedSurface, lens

CHUNK = {"cpu": 2**15, "cuda": 2**24}
"""Samples traced at a time; a record takes 24 bytes, and 24 more with its arrivals."""


@dataclass(frozen=True)
class Run:
    """Neighbouring pixels of the film, and how they are sampled.

    Attributes:
        first: the first pixel, row * width + column.
        pixels: how many.
        spp: camera samples in each.
        seed: any integer; its low 64 bits count.
    """

    first: int
    pixels: int
    spp: int
    seed: int

    def __len__(self) -> int:
        """Camera samples in all."""
        return self.pixels * self.spp

    def samples(self) -> kernels.Samples:
        """The run as kernels take it."""
        result: Any = kernels.Samples()
        result.first, result.spp = self.first, self.spp
        result.seed_low, result.seed_high = self.seed & 0xFFFFFFFF, (self.seed >> 32) & 0xFFFFFFFF
        return result


def runs(view: View, spp: int, seed: int, device: torch.device) -> list[Run]:
    """The film, cut into runs of at most `CHUNK` samples, or of one pixel."""
    film, size = view.width * view.height, max(1, CHUNK[device.type] // spp)
    return [Run(first, min(size, film - first), spp, seed) for first in range(0, film, size)]


@dataclass(frozen=True, eq=False)
class Records:
    """What became of the camera samples of a run, pixel by pixel.

    Attributes:
        run: which samples.
        part: the part met; -1, with uv and weight undefined, where there was nothing.
        uv: where it was met.
        weight: irradiance / pi / spp.
        arrivals: of each of the sample's two directions, the place in the environment (x, y in pixels) and the share
            of the radiance there in `weight`; undefined where there was nothing. Empty unless asked for.
    """

    run: Run
    part: Int[Tensor, " records"]
    uv: Float[Tensor, "records 2"]
    weight: Float[Tensor, "records 3"]
    arrivals: Float[Tensor, "kept 2 3"]

    def arguments(self) -> tuple[Any, ...]:
        """The records as kernels take them, but for the arrivals."""
        return *self.met(), wp.from_torch(self.weight, dtype=wp.vec3)

    def met(self) -> tuple[Any, ...]:
        """What was met where, as kernels take it."""
        return self.run.samples(), wp.from_torch(self.part), wp.from_torch(self.uv, dtype=wp.vec2)

    def transport(self) -> TransportSamples:
        """Those that met the surface."""
        index = (self.part >= 0).nonzero().squeeze(1)
        pixel = index // self.run.spp + self.run.first
        return TransportSamples(pixel, self.part[index].long(), self.uv[index], self.weight[index])


@dataclass(frozen=True, eq=False)
class Tracer:
    """Traces a view of a surface, and keeps arrivals if told. May be used from several threads at once."""

    surface: PreparedSurface
    lens: kernels.Lens
    light: emitter.Light
    arrivals: bool

    @classmethod
    def of(cls, surface: PreparedSurface, view: View, light: emitter.Light, *, arrivals: bool = False) -> Tracer:
        return cls(surface, lens(view, surface.centre), light, arrivals)

    def __call__(self, run: Run) -> Records:
        device = self.surface.device
        part = torch.empty(len(run), dtype=torch.int32, device=device)
        uv, weight = (torch.empty(len(run), n, dtype=torch.float32, device=device) for n in (2, 3))
        arrivals = torch.empty(len(run) if self.arrivals else 0, 2, 3, dtype=torch.float32, device=device)
        records = Records(run, part, uv, weight, arrivals)
        scene = (self.surface.geometry, self.lens)
        launch(kernels.find, len(run), (*scene, *records.met()), device)
        kept = wp.from_torch(arrivals, dtype=wp.vec3)
        launch(kernels.light_up, len(run), (*scene, self.light, *records.arguments(), kept), device)
        return records
