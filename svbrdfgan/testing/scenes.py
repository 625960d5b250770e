"""Small scenes with known answers."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray
from torch import Tensor

from svbrdfgan.protocols import Renderer
from svbrdfgan.types import Camera, Environment, Material, Materials, Part, Rendering, Surface, View

RED = (0.8, 0.1, 0.1)  # linear reflectance, as all colours here
GREEN = (0.1, 0.8, 0.1)


def surface_of(
    positions: Float[ndarray, "vertices 3"],
    normals: Float[ndarray, "vertices 3"],
    uv: Float[ndarray, "vertices 2"],
    faces: Int[ndarray, "faces 3"],
    face_part: Int[ndarray, " faces"] | None = None,
    repeat: tuple[bool, bool] = (False, False),
) -> Surface:
    """A surface that is its own mesh: uncut, one layer, with as many parts as `face_part` names."""
    face_part = np.zeros(len(faces), dtype=np.int64) if face_part is None else face_part
    return Surface(
        positions=np.asarray(positions, dtype=np.float64),
        normals=np.asarray(normals, dtype=np.float64),
        uv=np.asarray(uv, dtype=np.float64),
        faces=np.asarray(faces, dtype=np.int64),
        face_part=face_part,
        parts=tuple(Part(f"part{i}") for i in range(int(face_part.max()) + 1)),
        elevation=np.zeros(len(positions)),
        source_face=np.arange(len(faces)),
        source_barycentric=np.broadcast_to(np.eye(3), (len(faces), 3, 3)),
        repeat=repeat,
    )


def quad(corner: tuple[float, ...], right: tuple[float, ...], up: tuple[float, ...]) -> Surface:
    """A parallelogram; u runs along `right` and v along `up`, and it faces `right x up`."""
    origin, x, y = np.array(corner), np.array(right), np.array(up)
    normal = np.cross(x, y) / np.linalg.norm(np.cross(x, y))
    uv = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    positions = origin + uv[:, :1] * x + uv[:, 1:] * y
    return surface_of(positions, np.tile(normal, (4, 1)), uv, np.array([[0, 1, 2], [0, 2, 3]]))


def joined(*surfaces: Surface) -> Surface:
    """Several surfaces as one; their parts stay apart."""
    vertices = np.cumsum([0, *(len(s.positions) for s in surfaces)])
    parts = np.cumsum([0, *(len(s.parts) for s in surfaces)])
    return surface_of(
        np.concatenate([s.positions for s in surfaces]),
        np.concatenate([s.normals for s in surfaces]),
        np.concatenate([s.uv for s in surfaces]),
        np.concatenate([s.faces + first for s, first in zip(surfaces, vertices, strict=False)]),
        np.concatenate([s.face_part + first for s, first in zip(surfaces, parts, strict=False)]),
    )


def sphere(radius: float = 1.0, rows: int = 16, cols: int = 32) -> Surface:
    """A sphere about the origin with smooth normals; u goes around +Y from +Z by +X, v from bottom to top."""
    v, u = np.meshgrid(np.linspace(0.0, 1.0, rows + 1), np.linspace(0.0, 1.0, cols + 1), indexing="ij")
    theta, phi = np.pi * (1.0 - v), 2.0 * np.pi * u
    normals = np.stack([np.sin(theta) * np.sin(phi), np.cos(theta), np.sin(theta) * np.cos(phi)], axis=-1)
    vertex = np.arange((rows + 1) * (cols + 1)).reshape(rows + 1, cols + 1)
    a, b, c, d = vertex[:-1, :-1], vertex[:-1, 1:], vertex[1:, 1:], vertex[1:, :-1]
    faces = np.concatenate([np.stack([a, b, c], -1)[1:].reshape(-1, 3), np.stack([a, c, d], -1)[:-1].reshape(-1, 3)])
    normals = normals.reshape(-1, 3)
    return surface_of(radius * normals, normals, np.stack([u, v], -1).reshape(-1, 2), faces)


def plane(size: float = 1.0) -> Surface:
    """A square in the XY plane about the origin that faces +Z; u along +X, v along +Y."""
    return quad((-size / 2, -size / 2, 0.0), (size, 0.0, 0.0), (0.0, size, 0.0))


def square(normal: Sequence[float], size: float = 1.0) -> Surface:
    """A square about the origin that faces any direction."""
    z = np.array(normal, dtype=np.float64) / np.linalg.norm(normal)
    x = np.cross(np.eye(3)[np.abs(z).argmin()], z)
    x, y = size * x / np.linalg.norm(x), size * np.cross(z, x / np.linalg.norm(x))
    return quad(tuple(-(x + y) / 2.0), tuple(x), tuple(y))


def box(size: float = 1.0, centre: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Surface:
    """A cube of one part, its six faces flat."""
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    sides = joined(*(square(axis, size) for axis in axes))
    positions = sides.positions + np.repeat(axes * size / 2.0, 4, axis=0) + np.array(centre)
    return surface_of(positions, sides.normals, sides.uv, sides.faces)


def floor(size: float = 2.0) -> Surface:
    """A square on the ground that faces +Y; u along +X, v along -Z."""
    return quad((-size / 2, 0.0, size / 2), (size, 0.0, 0.0), (0.0, 0.0, -size))


def occluder() -> Surface:
    """A 2 m floor (part 0), and half a metre above its right half (+X) a lid (part 1)."""
    return joined(floor(2.0), quad((0.0, 0.5, 1.0), (1.0, 0.0, 0.0), (0.0, 0.0, -2.0)))


def two_parts() -> Surface:
    """The square of `plane(2)`, its left half (-X) part 0, its right half part 1."""
    height = (0.0, 2.0, 0.0)
    return joined(quad((-1.0, -1.0, 0.0), (1.0, 0.0, 0.0), height), quad((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), height))


def corner_box() -> Surface:
    """Three unit squares that meet in the origin and face one another, in the planes y = 0, x = 0 and z = 0."""
    return joined(
        quad((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0)),
        quad((0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)),
        quad((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    )


def bowl(rows: int = 32, cols: int = 64) -> Surface:
    """The lower half of the unit sphere."""
    whole = sphere(1.0, rows, cols)
    faces = whole.faces[whole.uv[whole.faces, 1].max(axis=1) < 0.5 + 1e-9]
    return surface_of(whole.positions, whole.normals, whole.uv, faces)


def shuffled(surface: Surface, seed: int = 0) -> Surface:
    """The same triangles in another order."""
    order = np.random.default_rng(seed).permutation(len(surface.faces))
    return dataclasses.replace(surface, faces=surface.faces[order], face_part=surface.face_part[order])


def grid(cells: int, size: float = 2.0) -> Surface:
    """The square of `plane`, cut into 2 * cells^2 triangles."""
    v, u = (np.indices((cells + 1, cells + 1)) / cells).reshape(2, -1)
    positions = np.stack([size * (u - 0.5), size * (v - 0.5), np.zeros_like(u)], axis=-1)
    vertex = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    a, b, c, d = (corner.ravel() for corner in (vertex[:-1, :-1], vertex[:-1, 1:], vertex[1:, 1:], vertex[1:, :-1]))
    faces = np.concatenate([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)])
    return surface_of(positions, np.tile([0.0, 0.0, 1.0], (len(positions), 1)), np.stack([u, v], axis=-1), faces)


def constant_light(radiance: float | tuple[float, float, float] = 1.0, rows: int = 4, cols: int = 8) -> Environment:
    """The same radiance from everywhere."""
    return Environment(torch.as_tensor(radiance, dtype=torch.float32).expand(rows, cols, 3).clone())


def random_light(rows: int = 8, cols: int = 16, seed: int = 0, rotation: float = 0.0) -> Environment:
    """Light with a random radiance in every pixel and channel, in [0, 1)."""
    radiance = torch.rand((rows, cols, 3), generator=torch.Generator().manual_seed(seed))
    return Environment(radiance, rotation)


def sun(row: int, col: int, rows: int = 64, cols: int = 128, rotation: float = 0.0) -> Environment:
    """Black, except for one pixel that lights a surface facing it with an irradiance of about pi."""
    radiance = torch.zeros(rows, cols, 3)
    radiance[row, col] = math.pi / _solid_angle(row, rows, cols)
    return Environment(radiance, rotation)


def sun_direction(
    row: int | Int[ndarray, "height width"], col: int | Int[ndarray, "height width"], rows: int = 64, cols: int = 128
) -> Float[ndarray, "3 ..."]:
    """The direction to each of these pixels: row 0 is the zenith, the middle column -Z, +X on its right."""
    theta, azimuth = np.pi * (row + 0.5) / rows, 2.0 * np.pi * ((col + 0.5) / cols - 0.5)
    return np.array([np.sin(theta) * np.sin(azimuth), np.cos(theta), -np.sin(theta) * np.cos(azimuth)])


def _solid_angle(row: int, rows: int, cols: int) -> float:
    """The solid angle of the bilinear tent about a pixel's centre, by the midpoint rule."""
    offset = (np.arange(200) + 0.5) / 100.0 - 1.0
    area = (1.0 - np.abs(offset)) * np.sin(np.pi * (row + 0.5 + offset) / rows) * 2.0 * np.pi**2 / (rows * cols)
    return float(area.sum() / 100.0)


def row_lights(*lit: int, rows: int = 16, cols: int = 8) -> Environment:
    """Black, except for some rows; each lights a surface that faces it with an irradiance of about pi."""
    radiance = torch.zeros(rows, cols, 3)
    for row in lit:
        radiance[row] = 1.0 / _solid_angle(row % rows, rows, 4)
    return Environment(radiance)


def front_view(
    environment: Environment, distance: float = 3.0, width: int = 16, height: int = 16, vertical_fov: float = 0.8
) -> View:
    """The view from +Z towards the origin: +X is to the right of the picture and +Y to its top."""
    return View(Camera((0.0, 0.0, distance), vertical_fov=vertical_fov), environment, width, height)


def spot_view(
    point: Sequence[float],
    toward: Sequence[float],
    environment: Environment,
    distance: float = 0.5,
    extent: float = 0.01,
) -> View:
    """A view of 4 x 4 pixels of the surroundings of a point, `extent` metres high, seen from a direction."""
    direction = np.array(toward, dtype=np.float64) / np.linalg.norm(toward)
    x, y, z = np.array(point) + distance * direction
    a, b, c = np.eye(3)[np.abs(direction).argmin()]
    target = (float(point[0]), float(point[1]), float(point[2]))
    fov = 2.0 * math.atan(0.5 * extent / distance)
    return View(Camera((float(x), float(y), float(z)), target, (a, b, c), fov), environment, 4, 4)


def corner_view(environment: Environment, width: int = 12, height: int = 12) -> View:
    """A view into the corner of `corner_box` that shows nothing but the inside."""
    return View(Camera((1.6, 1.4, 1.8), (0.25, 0.25, 0.25), vertical_fov=0.5), environment, width, height)


def lambertian(*base_colors: Tensor | tuple[float, float, float]) -> Materials:
    """A diffuse material for each part."""
    return Materials(tuple(Material.lambertian(color) for color in base_colors))


def material(**maps: float | Sequence[float] | Tensor) -> Material:
    """A material of these maps: numbers and sequences are constants, tensors textures or constants."""
    values = {name: torch.as_tensor(value, dtype=torch.float32) for name, value in maps.items()}
    return Material({name: value.reshape(1) if value.ndim == 0 else value for name, value in values.items()})


def with_alpha(surface: Surface, *alphas: float | ndarray) -> Surface:
    """The surface with these alphas, one for each part."""
    parts = zip(surface.parts, alphas, strict=True)
    return dataclasses.replace(surface, parts=tuple(dataclasses.replace(part, alpha=alpha) for part, alpha in parts))


def random_texture(rows: int, cols: int, seed: int = 0) -> Float[Tensor, "rows cols 3"]:
    """A texture with a random colour in every texel, in [0.2, 0.9)."""
    return 0.2 + 0.7 * torch.rand((rows, cols, 3), generator=torch.Generator().manual_seed(seed))


def picture(
    renderer: Renderer, surface: Surface, materials: Materials, view: View, spp: int = 4, seed: int = 0
) -> Rendering:
    """Prepares and renders the surface."""
    return renderer.render(renderer.prepare(surface), materials, view, spp=spp, seed=seed)


def surface_radiance(rendering: Rendering) -> Float[Tensor, 3]:
    """The mean radiance of what is seen of the surface."""
    return rendering.image.sum(dim=(0, 1)) / rendering.coverage.sum()
