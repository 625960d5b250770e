"""A renderer in plain torch: direct light on diffuse surfaces, in double precision, with gradients and transport."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from svbrdfgan.errors import ConfigError
from svbrdfgan.protocols import RendererCapabilities
from svbrdfgan.rendering.autograd_vjp import autograd_vjp
from svbrdfgan.types import Gradients, Materials, Rendering, Surface, TransportSamples, View
from svbrdfgan_example.grid import Grid, meet
from svbrdfgan_example.light import Light, bilinear


@dataclass(frozen=True, eq=False)
class Prepared:
    """A surface as tensors: normals (faces, 3, 3), uv (faces, 3, 2) and part (faces,) of each face's corners."""

    grid: Grid
    normals: Tensor
    uv: Tensor
    part: Tensor
    repeat: tuple[bool, bool]


@dataclass(frozen=True)
class GridRenderer:
    """Rays through a uniform grid; from each point one follows the cosine and one the environment.

    Attributes:
        density: cells of the grid for each triangle.
        chunk: camera samples at a time.

    Raises:
        ConfigError: an option is not positive.
    """

    density: float = 4.0
    chunk: int = 65536

    capabilities: ClassVar[RendererCapabilities] = RendererCapabilities(
        differentiable=frozenset({"base_color", "environment"}), transport=True
    )
    device: ClassVar[torch.device] = torch.device("cpu")

    def __post_init__(self) -> None:
        if not self.density > 0.0:
            raise ConfigError(f"density is {self.density}; wanted a positive number of cells for each triangle.")
        if self.chunk < 1:
            raise ConfigError(f"chunk is {self.chunk}; wanted 1 camera sample or more.")

    def prepare(self, surface: Surface) -> Prepared:
        """The surface as tensors, in a grid."""
        positions, normals, uv = (
            torch.from_numpy(a[surface.faces]).double() for a in (surface.positions, surface.normals, surface.uv)
        )
        grid = Grid.of_triangles(positions, self.density)
        return Prepared(grid, normals, uv, torch.tensor(surface.face_part), surface.repeat)

    def render(self, prepared: Prepared, materials: Materials, view: View, *, spp: int, seed: int) -> Rendering:
        """The picture: transport, times the textures."""
        with torch.no_grad():
            return self._picture(prepared, materials, view, spp, seed)

    def render_vjp(
        self,
        prepared: Prepared,
        materials: Materials,
        view: View,
        grad_image: Tensor,
        *,
        wrt: frozenset[str],
        spp: int,
        seed: int,
    ) -> Gradients:
        """The gradient by torch's own differentiation of the lookups; directions are constants."""
        return autograd_vjp(
            lambda given, lit: self._picture(prepared, given, lit, spp, seed).image,
            materials,
            view,
            grad_image,
            wrt=wrt,
        )

    def transport(self, prepared: Prepared, view: View, *, spp: int, seed: int) -> Iterator[TransportSamples]:
        """The samples that `render` multiplies with the textures."""
        samples = self._samples(prepared, view, spp, seed)
        return (TransportSamples(s.pixel, s.part, s.uv.float(), s.weight.detach().float()) for s in samples)

    def _picture(self, prepared: Prepared, materials: Materials, view: View, spp: int, seed: int) -> Rendering:
        """The picture, differentiable in base colours and radiance."""
        film = torch.zeros(view.height * view.width, 4, dtype=torch.float64)
        colors = [material.base_color.cpu().double() for material in materials.parts]
        for samples in self._samples(prepared, view, spp, seed):
            seen = torch.cat([samples.weight * _albedo(prepared, colors, samples), samples.share], dim=1)
            film = film.index_add(0, samples.pixel, seen)
        film = film.float().reshape(view.height, view.width, 4)
        return Rendering(film[..., :3].contiguous(), film[..., 3].clamp(max=1.0))

    def _samples(self, prepared: Prepared, view: View, spp: int, seed: int) -> Iterator[_Samples]:
        mixed = np.random.SeedSequence(seed % 2**64).generate_state(1)  # torch alone takes only the lower 32 bits
        rng = torch.Generator().manual_seed(int(mixed[0]))
        light = Light.of(view.environment, view.environment.radiance.cpu().double())
        total = view.height * view.width * spp
        for start in range(0, total, self.chunk):
            pixel = torch.arange(start, min(start + self.chunk, total)) // spp
            yield _trace(prepared, view, light, pixel, spp, rng)


@dataclass(frozen=True, eq=False)
class _Samples:
    """Camera samples that met the surface, as `TransportSamples`; `share` (n, 1) is one over the sample count."""

    pixel: Tensor
    part: Tensor
    uv: Tensor
    weight: Tensor
    share: Tensor


def _trace(prepared: Prepared, view: View, light: Light, pixel: Tensor, spp: int, rng: torch.Generator) -> _Samples:
    origin, ray = _camera_rays(view, pixel, rng)
    face = prepared.grid.nearest(origin, ray)
    seen = torch.nonzero(face >= 0)[:, 0]
    pixel, face, origin, ray = pixel[seen], face[seen], origin[seen], ray[seen]
    t, v, w = meet(prepared.grid.corners[face], origin, ray)
    weights = torch.stack([1 - v - w, v, w], dim=1).clamp(0, 1)[..., None]
    normal = F.normalize((weights * prepared.normals[face]).sum(1), dim=1)
    normal = torch.where((normal * ray).sum(1, keepdim=True) > 0, -normal, normal)
    point, weight = origin + t[:, None] * ray, torch.zeros(len(seen), 3, dtype=torch.float64)
    for bounce in (_by_cosine(normal, rng), light.sample(len(normal), rng)):
        lit = prepared.grid.nearest(point, bounce) < 0
        cosine = (bounce * normal).sum(1).clamp(min=0) / math.pi
        # the balance heuristic (Veach 1997): over both densities, whichever drew the direction
        share = cosine / (cosine + light.density(bounce)).clamp(min=1e-300)
        weight = weight + light.arriving(bounce) * (share * lit / spp)[:, None]
    uv = (weights * prepared.uv[face]).sum(1).clamp(0, 1)
    return _Samples(pixel, prepared.part[face], uv, weight, torch.full((len(pixel), 1), 1 / spp, dtype=torch.float64))


def _by_cosine(normal: Tensor, rng: torch.Generator) -> Tensor:
    """A direction for each normal, as likely as its cosine."""
    scattered = torch.randn(normal.shape, generator=rng, dtype=torch.float64)
    return F.normalize(normal + F.normalize(scattered, dim=1), dim=1)


def _camera_rays(view: View, pixel: Tensor, rng: torch.Generator) -> tuple[Tensor, Tensor]:
    """Rays through random points of these pixels."""
    jitter = torch.rand(len(pixel), 2, generator=rng, dtype=torch.float64)
    scale = 2 * math.tan(view.camera.vertical_fov / 2) / view.height
    x = (pixel % view.width + jitter[:, 0] - view.width / 2) * scale
    y = (view.height / 2 - pixel // view.width - jitter[:, 1]) * scale
    right, up, back = torch.from_numpy(view.camera.basis())
    ray = F.normalize(x[:, None] * right + y[:, None] * up - back, dim=1)
    return torch.tensor(view.camera.origin, dtype=torch.float64).expand_as(ray), ray


def _albedo(prepared: Prepared, colors: list[Tensor], samples: _Samples) -> Tensor:
    """The base color (n, 3) that each sample met."""
    albedo = torch.zeros_like(samples.weight)
    for part, color in enumerate(colors):
        mine = torch.nonzero(samples.part == part)[:, 0]
        if len(mine):
            found = (
                bilinear(color, samples.uv[mine], prepared.repeat) if color.ndim == 3 else color.expand(len(mine), 3)
            )
            albedo = albedo.index_put((mine,), found)
    return albedo
