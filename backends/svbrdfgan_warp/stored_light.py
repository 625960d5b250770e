"""The stored light of a view: hits of camera samples on learnable parts, and light samples that reach them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
import torch
import warp as wp
from jaxtyping import Bool, Float, Int
from torch import Tensor

from svbrdfgan.types import View
from svbrdfgan_warp import deferred_kernels, light_records
from svbrdfgan_warp.deferred_kernels import REDRAWS
from svbrdfgan_warp.device import in_order, quiet
from svbrdfgan_warp.emitter import EnvironmentEmitter
from svbrdfgan_warp.prepared_scene import FilmChunk, PreparedSurface, film_chunks, find_hits, prepare_camera


@dataclass(frozen=True, eq=False)
class Hits:
    """Camera samples that hit learnable parts, in the order of their pixels.

    Attributes:
        start: each pixel's first hit, row * width + column, and the number of hits.
        weight: what each hit of a pixel counts in it.
        pixel: of each hit.
        face: of each hit.
        at: barycentrics of the face's first two corners.
    """

    start: Int[Tensor, " pixels+1"]
    weight: Float[Tensor, " pixels"]
    pixel: Int[Tensor, " hits"]
    face: Int[Tensor, " hits"]
    at: Float[Tensor, "hits 2"]

    def __len__(self) -> int:
        return len(self.face)


@dataclass(eq=False)
class StoredLight:
    """The data of a view's picture that do not depend on the learnable materials, on one device.

    Attributes:
        camera_origin: in the prepared surface's coordinates.
        texture: of each part its number among the learnable parts; -1 for the others.
        textures: the number of learnable parts.
        light: the light sample of each hit, as `deferred_kernels` stores it.
        visit: for which it was drawn; at first one before all that visit 0 needs.
    """

    surface: PreparedSurface
    emitter: EnvironmentEmitter
    camera_origin: wp.vec3
    film: tuple[int, int]
    texture: Int[Tensor, " parts"]
    textures: int
    hits: Hits
    light: Int[Tensor, " hits"]
    seed: int
    visit: int = -REDRAWS

    @property
    def nbytes(self) -> int:
        """Bytes of its own tensors, without the surface and the environment."""
        return sum(tensor.nbytes for tensor in (*vars(self.hits).values(), self.light, self.texture))

    @cached_property
    def record(self) -> Int[Tensor, " bytes"]:
        """The view as kernels take it, in the device's memory; kept, since making it takes longer than shading."""
        surface, hits, view = self.surface, self.hits, deferred_kernels.StoredView()
        result: Any = view
        result.geometry, result.space, result.environment = surface.geometry, surface.tangent_space, self.emitter
        if surface.alpha is not None:
            result.alpha = surface.alpha
        result.origin, result.texture = self.camera_origin, wp.from_torch(self.texture)
        result.repeat_u, result.repeat_v = surface.surface.repeat
        result.start, result.weight = wp.from_torch(hits.start), wp.from_torch(hits.weight)
        result.pixel, result.face = wp.from_torch(hits.pixel), wp.from_torch(hits.face)
        result.at = wp.from_torch(hits.at, dtype=wp.vec2)
        result.light = wp.from_torch(self.light, dtype=wp.uint32)
        result.seed_low, result.seed_high = self.seed & 0xFFFFFFFF, (self.seed >> 32) & 0xFFFFFFFF
        made: Any = wp.array([view], dtype=deferred_kernels.StoredView, device=wp.device_from_torch(surface.device))
        plain: Any = wp.array(ptr=made.ptr, dtype=wp.uint8, shape=made.strides, device=made.device)
        return wp.to_torch(plain).clone()


def store_light(
    surface: PreparedSurface,
    emitter: EnvironmentEmitter,
    view: View,
    *,
    learnable: Sequence[int],
    hits: int,
    spp: int,
    seed: int,
) -> StoredLight:
    """Traces the camera samples of a view and keeps at most `hits` of each pixel. No light is drawn yet."""
    device = surface.device
    with quiet():
        wp.load_module(deferred_kernels, device=wp.device_from_torch(device))
    camera = prepare_camera(view, surface.centre)
    numbers = np.full(len(surface.surface.parts), -1, dtype=np.int32)
    numbers[list(learnable)] = np.arange(len(learnable))
    texture = torch.from_numpy(numbers).to(device)
    generator = torch.Generator(device).manual_seed(seed)
    chunks = partial(film_chunks, view, spp, seed, light_records.CHUNK[device.type])
    face_part = wp.to_torch(surface.geometry.face_part)

    def trace(chunk: FilmChunk) -> tuple[Tensor, Tensor]:
        face = torch.empty(len(chunk), dtype=torch.int32, device=device)
        at = torch.empty(len(chunk), 2, dtype=torch.float32, device=device)
        records = chunk.argument(), wp.from_torch(face), wp.from_torch(at, dtype=wp.vec2)
        find_hits(surface, camera, chunk, records)
        return face, at

    kept = [
        _kept(chunk, face, at, texture[face_part[face.clamp(min=0)]] >= 0, hits, generator)
        for chunk, (face, at) in zip(chunks(), in_order(trace, chunks(), device), strict=True)
    ]
    joined = _joined(kept)
    light = torch.empty(len(joined), dtype=torch.int32, device=device)
    film = (view.height, view.width)
    return StoredLight(surface, emitter, camera.origin, film, texture, len(learnable), joined, light, seed)


def _kept(
    chunk: FilmChunk,
    face: Int[Tensor, " samples"],
    at: Float[Tensor, "samples 2"],
    learnable: Bool[Tensor, " samples"],
    most: int,
    generator: torch.Generator,
) -> Hits:
    """The kept hits: at most `most` of each pixel, in a row from a random one on, all with equal probability.

    Samples in a row are spread over the pixel. Every fourth one, for instance, would lie in a quarter of its width, as
    `rng.numbers` reverses the bits of their numbers.
    """
    hit = ((face >= 0) & learnable).view(chunk.pixels, chunk.spp)
    found = hit.sum(dim=1, keepdim=True)
    candidates = found.clamp(min=most)
    number = torch.rand(chunk.pixels, 1, generator=generator, device=face.device, dtype=torch.float64)
    begin = (number * candidates).long()
    chosen = hit & ((hit.cumsum(dim=1) + begin) % candidates < most)
    count = chosen.sum(dim=1)
    index = chosen.flatten().nonzero().squeeze(1)
    return Hits(
        start=torch.nn.functional.pad(count.cumsum(dim=0), (1, 0)).int(),
        weight=found.squeeze(1).float() / (chunk.spp * count.clamp(min=1)),
        pixel=(index // chunk.spp + chunk.first).int(),
        face=face[index],
        at=at[index],
    )


def _joined(chunks: Sequence[Hits]) -> Hits:
    """The hits of consecutive chunks of the film."""
    starts, first = [chunks[0].start[:1]], 0
    for chunk in chunks:
        starts.append(chunk.start[1:] + first)
        first += len(chunk)
    joined = {name: torch.cat([getattr(chunk, name) for chunk in chunks]) for name in ("weight", "pixel", "face", "at")}
    return replace(chunks[0], start=torch.cat(starts), **joined)
