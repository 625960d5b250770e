"""The scene that is traced: a surface on the device, a camera, the film in chunks; and the records of tracing."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, cast

import numpy as np
import torch
import warp as wp
from jaxtyping import Float, Int
from numpy import ndarray
from torch import Tensor

from svbrdfgan.types import Surface, TransportSamples, View
from svbrdfgan_warp import alpha_kernels, emitter, rng, texture_kernels, trace_kernels
from svbrdfgan_warp.alpha_kernels import AlphaMaps
from svbrdfgan_warp.device import argument, finish, launch, quiet
from svbrdfgan_warp.frame import TangentSpace
from svbrdfgan_warp.shapes import Shape, ShapeCache, on_device

CHUNK = {"cpu": 2**15, "cuda": 2**24}
"""Camera samples traced at a time. A record takes 24 bytes, and 24 more with its light samples."""


@dataclass(frozen=True, eq=False)
class PreparedSurface:
    """Geometry on one device, moved so that `centre` lies at the origin, where float32 is finest.

    Attributes:
        geometry: what the kernels read.
        shape: what other surfaces may share of it.
        centre: middle of the bounding box, in the surface's own coordinates.
        surface: as it was given.
        alpha: of the parts; None if all are opaque.
    """

    geometry: trace_kernels.Geometry
    shape: Shape
    centre: Float[ndarray, 3]
    device: torch.device
    surface: Surface
    alpha: AlphaMaps | None

    @cached_property
    def tangent_space(self) -> TangentSpace:
        """The tangents of normal maps, computed when first used: most scenes need none."""
        return self.shape.tangent_space(self.surface)


def prepare(surface: Surface, device: torch.device, shapes: ShapeCache) -> PreparedSurface:
    """The surface on `device`, ready for use in any CUDA stream."""
    used = np.zeros(len(surface.positions), dtype=bool)
    used[surface.faces] = True
    low, high = (bound(surface.positions[used], axis=0) for bound in (np.min, np.max))
    centre = (low + high) / 2
    with quiet():
        for module in (trace_kernels, texture_kernels):
            wp.load_module(module, device=wp.device_from_torch(device))
    shape = shapes.shape(surface, centre)
    geometry: Any = trace_kernels.Geometry()
    geometry.nodes, geometry.triangles = shape.nodes, shape.triangles
    geometry.radius = float(np.linalg.norm(high - low)) / 2
    geometry.points, geometry.corners = wp.from_torch(shape.points, wp.vec3), wp.from_torch(shape.corners)
    geometry.normals = wp.from_torch(shape.normals, wp.vec3)
    geometry.uv = wp.from_torch(on_device(surface.uv, np.float32, device), wp.vec2)
    geometry.face_part = wp.from_torch(on_device(surface.face_part, np.int32, device))
    opaque = all(part.opaque for part in surface.parts)
    alpha = None if opaque else _alpha_maps(surface, geometry, device)
    finish(device)
    return PreparedSurface(geometry, shape, centre, device, surface, alpha)


def _alpha_maps(surface: Surface, geometry: trace_kernels.Geometry, device: torch.device) -> AlphaMaps:
    """The alpha of all parts in one array; a constant is one texel."""
    with quiet():
        wp.load_module(alpha_kernels, device=wp.device_from_torch(device))
    maps = [np.atleast_2d(np.asarray(part.alpha, dtype=np.float32)) for part in surface.parts]
    first = np.cumsum([0, *(each.size for each in maps[:-1])])
    layout = np.array([(begin, *each.shape) for begin, each in zip(first, maps, strict=True)], dtype=np.int32)
    result: Any = alpha_kernels.AlphaMaps()
    result.layout = wp.from_torch(torch.from_numpy(layout).to(device), dtype=wp.vec3i)
    result.texels = wp.from_torch(torch.from_numpy(np.concatenate([each.ravel() for each in maps])).to(device))
    result.repeat_u, result.repeat_v = surface.repeat
    result.corners, result.uv, result.face_part = geometry.corners, geometry.uv, geometry.face_part
    return cast(AlphaMaps, result)


def prepare_camera(view: View, centre: Float[ndarray, 3]) -> trace_kernels.PreparedCamera:
    """The camera in the prepared surface's coordinates; its axes are scaled to half the film's width and height."""
    camera = view.camera
    right, top, backward = camera.basis()
    half = np.tan(camera.vertical_fov / 2)
    result: Any = trace_kernels.PreparedCamera()
    # Subtracted in float64: a vehicle far from the world's origin would lose digits in float32.
    result.origin = wp.vec3(*(np.asarray(camera.origin, dtype=np.float64) - centre))
    result.right = wp.vec3(*(right * half * view.width / view.height))
    result.top = wp.vec3(*(top * half))
    result.forward = wp.vec3(*-backward)
    result.width, result.height = view.width, view.height
    return result


@dataclass(frozen=True)
class FilmChunk:
    """Consecutive pixels of the film, and how they are sampled.

    Attributes:
        first: the first pixel, row * width + column.
        pixels: their number.
        spp: camera samples in each.
        seed: any integer; its low 64 bits are used.
    """

    first: int
    pixels: int
    spp: int
    seed: int

    def __len__(self) -> int:
        """The number of camera samples."""
        return self.pixels * self.spp

    def argument(self) -> trace_kernels.SampleRange:
        """The chunk as kernels take it."""
        result: Any = trace_kernels.SampleRange()
        result.first, result.spp = self.first, self.spp
        result.seed_low, result.seed_high = self.seed & 0xFFFFFFFF, (self.seed >> 32) & 0xFFFFFFFF
        return result


def film_chunks(view: View, spp: int, seed: int, most: int) -> Iterator[FilmChunk]:
    """The film, cut into chunks of at most `most` samples, or of one pixel.

    Each is made when it is asked for: there may be millions.
    """
    film, size = view.width * view.height, max(1, most // spp)
    for first in range(0, film, size):
        yield FilmChunk(first, min(size, film - first), spp, seed)


@lru_cache(maxsize=16)
def by_height(spp: int, device: torch.device) -> Any:
    """The samples of a pixel in the order of their height in it, as kernels take them.

    Threads that run together then trace rays that pass close to each other: samples of consecutive numbers are spread
    over the pixel (`rng.numbers`).
    """
    number = np.arange(spp, dtype=np.uint32)
    reversed_bits = np.bitwise_or.reduce([(number >> bit & 1) << (31 - bit) for bit in range(32)])
    height = reversed_bits * np.uint32(rng.LATTICE_U[1])
    return wp.from_torch(on_device(height.argsort(), np.int32, device))


@dataclass(frozen=True, eq=False)
class SampleRecords:
    """The hits of a chunk's camera samples, pixel by pixel, and the light there.

    Attributes:
        chunk: which samples.
        part: the part hit; -1 for a miss, where uv and weight are undefined.
        uv: texture coordinates of the hit.
        weight: irradiance / pi / spp.
        light_samples: for each of the sample's two light directions the environment's pixel coordinates (x, y), and the
            factor of the radiance there in `weight`; undefined for a miss. Empty unless asked for.
    """

    chunk: FilmChunk
    part: Int[Tensor, " records"]
    uv: Float[Tensor, "records 2"]
    weight: Float[Tensor, "records 3"]
    light_samples: Float[Tensor, "kept 2 3"]

    def arguments(self) -> tuple[Any, ...]:
        """The records without light samples, as kernels take them."""
        return *self.hits(), argument(self.weight, wp.vec3)

    def hits(self) -> tuple[Any, ...]:
        """Samples, part and uv, as kernels take them."""
        return self.chunk.argument(), argument(self.part), argument(self.uv, wp.vec2)

    def transport(self) -> TransportSamples:
        """The records of the samples that hit the surface."""
        index = (self.part >= 0).nonzero().squeeze(1)
        pixel = index // self.chunk.spp + self.chunk.first
        return TransportSamples(pixel, self.part[index].long(), self.uv[index], self.weight[index])


def find_hits(
    surface: PreparedSurface, camera: trace_kernels.PreparedCamera, chunk: FilmChunk, records: tuple[Any, ...]
) -> None:
    """Stores the hits of a chunk's camera samples, on parts that are there, in the records' faces and barycentrics."""
    geometry = surface.geometry
    if surface.alpha is None:
        order = by_height(chunk.spp, surface.device)
        launch(trace_kernels.find_hits, len(chunk), (geometry, camera, *records, order), surface.device)
    else:
        given = (geometry, surface.alpha, camera, *records)
        launch(alpha_kernels.find_hits_through, len(chunk), given, surface.device)


@dataclass(frozen=True, eq=False)
class Tracer:
    """Traces chunks of a view's film, with light samples if asked to. Several threads may call it at once."""

    surface: PreparedSurface
    camera: trace_kernels.PreparedCamera
    emitter: emitter.EnvironmentEmitter
    light_samples: bool

    def __call__(self, chunk: FilmChunk) -> SampleRecords:
        device = self.surface.device
        part = torch.empty(len(chunk), dtype=torch.int32, device=device)
        uv, weight = (torch.empty(len(chunk), n, dtype=torch.float32, device=device) for n in (2, 3))
        kept = torch.empty(len(chunk) if self.light_samples else 0, 2, 3, dtype=torch.float32, device=device)
        records = SampleRecords(chunk, part, uv, weight, kept)
        find_hits(self.surface, self.camera, chunk, records.hits())
        light_samples, order = argument(kept, wp.vec3), by_height(chunk.spp, device)
        given = (self.surface.geometry, self.camera, self.emitter, *records.arguments(), light_samples, order)
        launch(trace_kernels.illuminate_hits, len(chunk), given, device)
        return records
