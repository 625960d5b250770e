"""The records of whole materials: what camera samples hit, and light samples that hold nothing of the maps."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import torch
import warp as wp
from jaxtyping import Float, Int
from torch import Tensor

from svbrdfgan_warp import alpha_kernels, emitter, material_kernels, trace_kernels
from svbrdfgan_warp.device import launch
from svbrdfgan_warp.frame import TangentSpace
from svbrdfgan_warp.prepared_scene import FilmChunk, PreparedSurface, SampleRecords, find_hits

CHUNK = {"cpu": 2**15, "cuda": 2**22}
"""Camera samples at a time. A record takes 36 bytes, its radiance 12, and its gradients up to 56."""


@dataclass(frozen=True, eq=False)
class LightRecords:
    """The hits of a chunk's camera samples and two light samples for each; see `material_kernels`.

    Attributes:
        chunk: which samples.
        face: the face hit; -1 for a miss, where the others are undefined.
        at: barycentrics of its first two corners.
        light: for each of two directions its position (x, y) in the environment, in pixels, and the factor of
            value * radiance in the picture.
    """

    chunk: FilmChunk
    face: Int[Tensor, " records"]
    at: Float[Tensor, "records 2"]
    light: Float[Tensor, "records 2 3"]

    @classmethod
    def empty(cls, chunk: FilmChunk, device: torch.device) -> LightRecords:
        face = torch.empty(len(chunk), dtype=torch.int32, device=device)
        at = torch.empty(len(chunk), 2, dtype=torch.float32, device=device)
        return cls(chunk, face, at, torch.empty(len(chunk), 2, 3, dtype=torch.float32, device=device))

    @cached_property
    def hits(self) -> tuple[Any, ...]:
        """Samples, face and barycentrics, as kernels take them."""
        return self.chunk.argument(), wp.from_torch(self.face), wp.from_torch(self.at, dtype=wp.vec2)

    @cached_property
    def argument(self) -> material_kernels.Records:
        """The records as kernels take them."""
        result: Any = material_kernels.Records()
        result.samples, result.face, result.at = self.hits
        result.light = wp.from_torch(self.light, dtype=wp.vec3)
        return result


@dataclass(frozen=True, eq=False)
class LightTracer:
    """Traces the records of a view. Several threads may call it at once.

    Attributes:
        space: tangents, or none where no part has a normal map.
        dark: whether directions without light matter, as they do for the environment's gradient.
    """

    surface: PreparedSurface
    space: TangentSpace
    camera: trace_kernels.PreparedCamera
    emitter: emitter.EnvironmentEmitter
    dark: bool

    def scene(self) -> tuple[Any, ...]:
        """Geometry, tangents, camera and light, as kernels take them."""
        return self.surface.geometry, self.space, self.camera, self.emitter

    def __call__(self, chunk: FilmChunk, maps: material_kernels.Maps) -> LightRecords:
        device, geometry = self.surface.device, self.surface.geometry
        records = LightRecords.empty(chunk, device)
        argument = records.argument
        traced: tuple[Any, ...] = (geometry,)
        trace_shadows = material_kernels.trace_shadows
        if self.surface.alpha is not None:
            traced, trace_shadows = (geometry, self.surface.alpha), alpha_kernels.trace_shadows_through
        find_hits(self.surface, self.camera, chunk, records.hits)
        launch(material_kernels.draw_light, len(chunk), (*self.scene(), maps, self.dark, argument), device)
        launch(trace_shadows, 2 * len(chunk), (*traced, self.emitter, argument), device)
        return records

    def lambertian(self, chunk: FilmChunk, maps: material_kernels.Maps) -> SampleRecords:
        """The records of parts that are all Lambertian, as the tracer of base colours has them."""
        device, records = self.surface.device, self(chunk, maps)
        part = torch.empty(len(chunk), dtype=torch.int32, device=device)
        uv, weight = (torch.empty(len(chunk), n, dtype=torch.float32, device=device) for n in (2, 3))
        result = SampleRecords(chunk, part, uv, weight, records.light[:0])
        given = (*self.scene(), records.argument, *result.arguments()[1:])
        launch(material_kernels.weigh, len(chunk), given, device)
        return result
