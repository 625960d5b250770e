"""The scene that Mitsuba renders: a surface, its camera, and the film in chunks with their camera samples."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray
from torch import Tensor

from svbrdfgan.types import Surface, View
from svbrdfgan_mitsuba.interop import dr, floats, tensor, unsigned
from svbrdfgan_mitsuba.normal_map import TangentFrames
from svbrdfgan_mitsuba.textures import Atlas
from svbrdfgan_mitsuba.variant import assign, instantiate, load

VERTICES = {"cpu": 2**20, "cuda": 2**23}
"""Path vertices held in memory at a time, at most 100 bytes each."""


@dataclass(frozen=True, eq=False)
class PreparedSurface:
    """A surface on one device, moved and scaled into the unit sphere, so that one ray offset suits every surface.

    Attributes:
        scene: the triangles and their search tree.
        mesh: the triangles alone, queried directly: a call through the scene would compile in every shape that
            is alive in the process.
        face_part: the part of each face.
        tangents: for normal maps.
        alpha: of the parts; None if all are opaque, so that their kernels know nothing of it.
        centre, radius: of the sphere, in the surface's own coordinates.
        parts: the parts' names.
        repeat: `Surface.repeat`.
    """

    mi: Any
    scene: Any
    mesh: Any
    face_part: Any
    tangents: TangentFrames
    alpha: Atlas | None
    centre: Float[ndarray, 3]
    radius: float
    parts: tuple[str, ...]
    repeat: tuple[bool, bool]
    device: torch.device


def prepare(surface: Surface, device: torch.device) -> PreparedSurface:
    """The surface with its search tree on `device`."""
    mi = load(device)
    used = surface.positions[np.unique(surface.faces)]
    centre = (used.min(axis=0) + used.max(axis=0)) / 2
    radius = float(np.linalg.norm(used - centre, axis=1).max()) or 1.0  # a surface may be a single point
    mesh = _mesh(mi, surface, (surface.positions - centre) / radius, device)
    return PreparedSurface(
        mi=mi,
        scene=instantiate(device, {"type": "scene", "surface": mesh}),
        mesh=mesh,
        face_part=unsigned(mi, torch.tensor(surface.face_part), device),
        tangents=TangentFrames(mi, surface, device),
        alpha=_alpha(mi, surface, device),
        centre=centre,
        radius=radius,
        parts=tuple(part.name for part in surface.parts),
        repeat=surface.repeat,
        device=device,
    )


@dataclass(frozen=True, eq=False)
class PreparedCamera:
    """A camera in the prepared surface's coordinates; its axes are scaled to half the film's width and height."""

    mi: Any
    origin: Any
    right: Any
    top: Any
    forward: Any
    width: Any
    height: Any

    @classmethod
    def of(cls, prepared: PreparedSurface, view: View) -> PreparedCamera:
        """The view's camera, with numbers that are opaque to Dr.Jit: literals would be compiled into the kernels."""
        mi, camera = prepared.mi, view.camera
        right, top, backward = camera.basis()
        half = np.tan(camera.vertical_fov / 2)
        origin = (np.asarray(camera.origin, dtype=np.float64) - prepared.centre) / prepared.radius

        def vector(values: Float[ndarray, 3]) -> Any:
            return mi.Vector3f(*(dr.opaque(mi.Float, float(value)) for value in values))

        return cls(
            mi=mi,
            origin=vector(origin),
            right=vector(right * (half * view.width / view.height)),
            top=vector(top * half),
            forward=vector(-backward),
            width=dr.opaque(mi.UInt32, view.width),
            height=dr.opaque(mi.UInt32, view.height),
        )

    def rays(self, pixel: Any, random: Any) -> Any:
        """Rays through pixels (row * width + column), placed within each by `random`."""
        mi = self.mi
        row = pixel // self.width
        col = pixel - row * self.width
        x = (mi.Float(col) + random.x) * (2.0 / mi.Float(self.width)) - 1.0
        y = 1.0 - (mi.Float(row) + random.y) * (2.0 / mi.Float(self.height))
        return mi.Ray3f(mi.Point3f(self.origin), dr.normalize(self.right * x + self.top * y + self.forward))


@dataclass(frozen=True)
class FilmChunk:
    """Consecutive pixels of the film, and how they are sampled.

    Attributes:
        first: the first pixel, row * width + column.
    """

    first: int
    pixels: int
    spp: int
    seed: int

    @property
    def span(self) -> slice:
        """The chunk's pixels in the film."""
        return slice(self.first, self.first + self.pixels)

    def mean(self, mi: Any, values: Any) -> Tensor:
        """The mean of each pixel's samples, flat, with the channels of a pixel together."""
        dr.eval(values)
        return tensor(dr.ravel(dr.block_sum(values, self.spp) / dr.opaque(mi.Float, self.spp)))

    def mean_vjp(self, mi: Any, grad_image: Float[Tensor, "pixels 3"]) -> Any:
        """The transpose of `mean`: the gradient at each sample."""
        pixel = dr.arange(mi.UInt32, self.pixels * self.spp) // dr.opaque(mi.UInt32, self.spp)
        given = dr.gather(mi.Color3f, floats(mi, grad_image, grad_image.device), pixel)
        return given / dr.opaque(mi.Float, self.spp)


def film_chunks(pixels: int, spp: int, seed: int, bounces: int, device: torch.device) -> Iterator[FilmChunk]:
    """A film of this many pixels, cut into chunks of at most `VERTICES` path vertices, or of one pixel.

    Each is made when it is asked for: there may be millions.
    """
    size = max(1, VERTICES[device.type] // (spp * bounces))
    for first in range(0, pixels, size):
        yield FilmChunk(first, min(size, pixels - first), spp, seed)


@dataclass(frozen=True, eq=False)
class CameraSamples:
    """The camera samples of a film chunk, pixel by pixel, and their random numbers.

    The numbers are a function of seed, pixel, sample and depth (Philox, Salmon et al. 2011), so a picture does not
    depend on how its film is cut.
    """

    mi: Any
    seed: Any
    pixel: Any
    sample: Any

    @classmethod
    def of(cls, mi: Any, chunk: FilmChunk) -> CameraSamples:
        """All samples of the chunk."""
        index, spp = dr.arange(mi.UInt32, chunk.pixels * chunk.spp), dr.opaque(mi.UInt32, chunk.spp)
        pixel, seed = index // spp, dr.opaque(mi.UInt64, chunk.seed % 2**64)
        return cls(mi, seed, pixel + dr.opaque(mi.UInt32, chunk.first), index - pixel * spp)

    def rng(self, depth: int) -> Any:
        """A random number generator for each sample at a depth of its path."""
        return self.mi.Philox4x32(self.seed, self.pixel, self.sample, dr.opaque(self.mi.UInt32, depth))


def _alpha(mi: Any, surface: Surface, device: torch.device) -> Atlas | None:
    if all(part.opaque for part in surface.parts):
        return None
    given = (torch.from_numpy(np.array(part.alpha, dtype=np.float32))[..., None] for part in surface.parts)
    return Atlas.of(mi, list(given), torch.ones(1), surface.repeat, device)


def _mesh(mi: Any, surface: Surface, positions: Float[ndarray, "vertices 3"], device: torch.device) -> Any:
    def values(array: ndarray) -> Any:
        return floats(mi, torch.from_numpy(array.astype(np.float32)), device)

    vertices, faces = len(surface.positions), len(surface.faces)
    mesh = mi.Mesh("surface", vertices, faces, has_vertex_normals=True, has_vertex_texcoords=True)
    arrays = {
        "vertex_positions": values(positions),
        "vertex_normals": values(surface.normals),
        "vertex_texcoords": values(surface.uv),
        "faces": unsigned(mi, torch.tensor(surface.faces), device),
    }
    assign(mi, mesh, arrays)
    mesh.recompute_bbox()
    mesh.initialize()  # not `parameters_changed`, which would replace the normals by Mitsuba's own
    return mesh
