"""The scenes in which renderers are compared, each with something that renderers often get wrong."""

from __future__ import annotations

import hashlib
import math
import os
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from types import MappingProxyType

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray
from torch import Tensor

from svbrdfgan.errors import AssetError, ConfigError
from svbrdfgan.geometry.layers import hide_inner_layers
from svbrdfgan.io.environment import load_environment
from svbrdfgan.io.mesh import load_mesh
from svbrdfgan.plugins.registry import load_embedding
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.sky import SkyParameters, build_sky
from svbrdfgan.procedural.vehicle import build_vehicle
from svbrdfgan.testing.scenes import bowl, corner_box, floor, joined, quad, random_light, random_texture
from svbrdfgan.testing.scenes import sphere as ball
from svbrdfgan.types import Camera, Environment, Material, Materials, Mesh, Surface, View

ASSETS = "SVBRDFGAN_ASSETS"  # the variable that names the folder of real cars and lights
FILM = 64  # pixels along a side
TEXTURE = 16  # texels along a side
_REAL_CAR = ("cars/quaternius_real_normalcar1.glb", "envmaps/pmndrs_sunset.hdr")
_REFINED = 32  # resolution of the embedding of vehicles: coarse, so that the slowest renderer can follow
_SAME = 5e-5  # by how much measures of one scene may differ


class SceneUnavailableError(AssetError):
    """The files of a scene are not on this machine."""


@dataclass(frozen=True, eq=False)
class PairScene:
    """One row of the table.

    Attributes:
        surface: every part has its own textures, of TEXTURE x TEXTURE texels.
        groups: for each part, the group that its texels are counted in.
        max_bounces: of the paths to compare.
    """

    name: str
    surface: Surface
    materials: Materials
    view: View
    groups: tuple[int, ...]
    max_bounces: int = 1

    @property
    def group_count(self) -> int:
        return max(self.groups) + 1

    @property
    def pixels(self) -> int:
        return self.view.width * self.view.height

    @property
    def maps(self) -> frozenset[str]:
        """The maps that a renderer must read."""
        return frozenset[str]().union(*(material.maps for material in self.materials.parts))

    def fingerprint(self) -> str:
        """A fingerprint for `same_scene`: a hash of everything but the surface, and measures of the surface."""
        digest = hashlib.sha256(f"{self.groups} {self.max_bounces} {self.surface.repeat}".encode())
        for array in self._arrays():
            scale = float(np.abs(array).max()) or 1.0
            steps = np.rint(array / scale * 777_777.7).astype(np.int64)  # no round number: few values lie on an edge
            digest.update(f"{array.shape} {scale:.5e}".encode() + steps.tobytes())
        return " ".join([digest.hexdigest()[:16], *(f"{value:.7f}" for value in _measures(self.surface))])

    def _arrays(self) -> Iterator[Float[ndarray, "*shape"]]:
        view, camera = self.view, self.view.camera
        yield from (material.base_color.double().numpy() for material in self.materials.parts)
        for material in self.materials.parts:
            yield from (material.maps[name].double().numpy() for name in sorted(material.maps.keys() - {"base_color"}))
        yield view.environment.radiance.double().numpy()
        yield np.array([*camera.origin, *camera.target, *camera.up, camera.vertical_fov, view.environment.rotation])
        yield np.array([view.width, view.height])


def same_scene(one: str, other: str) -> bool:
    """Whether two fingerprints are of one scene, as different processors make it.

    Processors round differently, and where two diagonals of a quad are equally good, a procedural vehicle then gets the
    other one: 63 of 8,066 triangles without AVX2, which moved no measure by more than 2e-5.
    """
    (digest, *measures), (others, *expected) = one.split(), other.split()
    if digest != others or len(measures) != len(expected):
        return False
    return bool(np.allclose(np.array(measures, float), np.array(expected, float), rtol=0, atol=_SAME))


def _measures(surface: Surface) -> Float[ndarray, " measures"]:
    """Area, and means over it of positions, their squares, normals, UVs and products of these; each part's share."""
    corners = surface.positions[surface.faces]
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    place, uv, normal = (
        values[surface.faces].mean(axis=1) for values in (surface.positions, surface.uv, surface.normals)
    )
    known = np.concatenate([place, place**2, normal, uv, uv**2, place * uv[:, :1], place * uv[:, 1:]], axis=1)
    parts = np.bincount(surface.face_part, area, minlength=len(surface.parts))
    found = np.concatenate([[area.sum()], area @ known / area.sum(), parts / area.sum()])
    return found.round(7) + 0.0  # no -0, whose text differs


def _scene(
    name: str,
    surface: Surface,
    camera: Camera,
    light: Environment,
    *,
    groups: tuple[int, ...] = (),
    bounces: int = 1,
    maps: Collection[str] = (),
) -> PairScene:
    """The scene with random textures on every part, and each part a group of its own unless `groups` says more."""
    parts = range(len(surface.parts))
    materials = Materials(tuple(_random_material(part, maps) for part in parts))
    return PairScene(name, surface, materials, View(camera, light, FILM, FILM), groups or tuple(parts), bounces)


def _random_material(seed: int, maps: Collection[str]) -> Material:
    """A random base colour and, of these maps, roughness in [0.3, 0.65), metallic in [0, 1], normals to 35 degrees."""
    color, values, tilts = (random_texture(TEXTURE, TEXTURE, seed=seed + further) for further in (0, 100, 200))
    textures = {
        "roughness": 0.2 + 0.5 * values[..., :1],
        "metallic": (2.0 * values[..., 1:2] - 0.6).clamp(0.0, 1.0),
        "normal": tilts - torch.tensor([0.55, 0.55, -0.4]),
    }
    return Material({"base_color": color, **{name: textures[name] for name in textures if name in maps}})


def ellipsoid(axes: tuple[float, float, float], centre: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Surface:
    """A closed convex surface with smooth normals."""
    unit = ball(1.0, 24, 48)
    normals = unit.normals / axes
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    return replace(unit, positions=unit.positions * axes + centre, normals=normals)


def soft_light(seed: int, rows: int = 16, strength: float = 1.0) -> Environment:
    """Light from everywhere, in large coloured patches of about equal brightness, turned by half a radian."""
    coarse = 0.3 + random_light(4, 8, seed).radiance.double().numpy()
    smooth = np.einsum("ri,cj,ijk->rck", _stretched(4, rows), _stretched(8, 2 * rows), coarse)
    steps = np.rint(256.0 * smooth) / 256.0  # so that no processor's rounding shows
    return Environment(strength * torch.from_numpy(steps).float(), rotation=0.5)


def _stretched(count: int, size: int) -> Float[ndarray, "size count"]:
    """The weights that stretch `count` values over `size`, linear in between."""
    at = np.linspace(0.0, count - 1.0, size)
    return np.stack([np.interp(at, np.arange(count), unit) for unit in np.eye(count)], axis=1)


def sunlit(seed: int, rows: int = 64, ratio: float = 1e4) -> Environment:
    """Soft light with a single pixel that is `ratio` times as bright as the rest, whose mean is 0.8."""
    light = soft_light(seed, rows)
    radiance = light.radiance.clone()
    radiance[rows // 5, 2 * rows // 3] = ratio * 0.8
    return replace(light, radiance=radiance)


def _convex() -> PairScene:
    camera = Camera((1.1, 0.9, 2.6), vertical_fov=0.48)
    return _scene("convex", ellipsoid((1.0, 0.6, 0.8)), camera, soft_light(1))


def _occluding() -> PairScene:
    lid = quad((-0.6, 0.45, 0.7), (1.2, 0.0, 0.0), (0.0, 0.0, -1.2))
    return _scene(
        "occluding", joined(floor(2.0), lid), Camera((0.5, 1.3, 2.1), (0.0, 0.1, 0.0), vertical_fov=0.68), soft_light(2)
    )


def _multi_part() -> PairScene:
    wall = quad((-1.0, 0.0, -0.8), (2.0, 0.0, 0.0), (0.0, 1.3, 0.0))
    surface = joined(floor(2.0), ellipsoid((0.6, 0.4, 0.4), (0.0, 0.45, 0.0)), wall)
    return _scene("multi-part", surface, Camera((0.6, 1.1, 2.6), (0.0, 0.4, 0.0), vertical_fov=0.6), soft_light(3))


def _interreflecting() -> PairScene:
    camera = Camera((1.6, 1.4, 1.8), (0.3, 0.3, 0.3), vertical_fov=0.42)
    return _scene("interreflecting", corner_box(), camera, soft_light(4), bounces=3)


def _strong_sun() -> PairScene:
    surface = joined(floor(2.0), ellipsoid((0.6, 0.5, 0.5), (0.0, 0.5, 0.0)))
    return _scene("strong sun", surface, Camera((1.0, 1.5, 2.4), (0.0, 0.3, 0.0), vertical_fov=0.6), sunlit(5))


def _low_light() -> PairScene:
    camera, dim = Camera((0.4, 1.9, 1.5), (0.0, -0.3, 0.0), vertical_fov=0.74), soft_light(6, strength=1e-4)
    return _scene("low light", bowl(16, 32), camera, dim)


def _vehicle() -> PairScene:
    sky = SkyParameters(sun_elevation=math.radians(40.0), sun_azimuth=0.6, cloud_cover=0.3, seed=7)
    return _on_wheels("vehicle", build_vehicle(sample_vehicle("hatchback", 7)), build_sky(sky, 32, 64))


def _real_car() -> PairScene:
    mesh, light = (_asset(name) for name in _REAL_CAR)
    return _on_wheels("real car", load_mesh(mesh), load_environment(light))


def _still_life(name: str, light: str, maps: Collection[str]) -> PairScene:
    """An ellipsoid on a floor, with these maps, under an HDRI."""
    surface = joined(floor(2.0), ellipsoid((0.6, 0.5, 0.5), (0.0, 0.5, 0.0)))
    camera = Camera((1.0, 1.5, 2.4), (0.0, 0.3, 0.0), vertical_fov=0.6)
    return _scene(name, surface, camera, Environment(load_environment(_asset(f"envmaps/{light}.hdr"))), maps=maps)


def _asset(name: str) -> Path:
    folder = os.environ.get(ASSETS)
    if not folder:
        raise SceneUnavailableError(f"{ASSETS} is not set: point it at a folder with cars/ and envmaps/ to compare it.")
    return Path(folder) / name


def _on_wheels(name: str, mesh: Mesh, light: Float[Tensor, "rows cols 3"]) -> PairScene:
    """A vehicle of length 1, embedded and peeled as for learning; its paint is one group, all else the other."""
    embedded = load_embedding("hemispherical", {"resolution": _REFINED}).embed(mesh)
    surface = hide_inner_layers(embedded, _REFINED)
    camera = Camera.orbit(0.5, 0.35, 1.9, (0.0, 0.14, 0.0), vertical_fov=0.36)
    groups = tuple(int(part > 0) for part in range(len(surface.parts)))
    return _scene(name, surface, camera, Environment(light), groups=groups)


SCENES: Mapping[str, Callable[[], PairScene]] = MappingProxyType(
    {
        "convex": _convex,
        "occluding": _occluding,
        "multi-part": _multi_part,
        "interreflecting": _interreflecting,
        "strong sun": _strong_sun,
        "low light": _low_light,
        "vehicle": _vehicle,
        "real car": _real_car,
        "glossy": partial(_still_life, "glossy", "pmndrs_studio", {"roughness"}),
        "metallic": partial(_still_life, "metallic", "pmndrs_lobby", {"roughness", "metallic"}),
        "normal-mapped": partial(_still_life, "normal-mapped", "pmndrs_sunset", {"roughness", "metallic", "normal"}),
    }
)
"""The scenes of the table, in its order."""


@cache
def make_scene(name: str) -> PairScene:
    """The scene of that name; made once in a process, and never changed.

    Raises:
        ConfigError: there is none of that name.
        SceneUnavailableError: the scene needs files that this machine does not have.
    """
    if name not in SCENES:
        raise ConfigError(f"scene {name!r} is unknown; known are {', '.join(SCENES)}.")
    return SCENES[name]()
