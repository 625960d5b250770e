"""A surface in Mitsuba, and where rays meet it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan.types import Surface, View
from svbrdfgan_mitsuba.interop import floats, unsigned
from svbrdfgan_mitsuba.jit import dr
from svbrdfgan_mitsuba.variant import assign, instantiate, load


@dataclass(frozen=True, eq=False)
class PreparedSurface:
    """A surface on one device, moved and scaled into the unit sphere: Mitsuba's offsets are made for such sizes.

    Attributes:
        scene: the triangles and their search tree.
        mesh: the triangles alone; asked directly, so that kernels do not depend on what other shapes there are.
        face_part: the part of each face.
        centre, radius: of the sphere, in the surface's own coordinates.
        parts: the parts' names.
        repeat: `Surface.repeat`.
    """

    mi: Any
    scene: Any
    mesh: Any
    face_part: Any
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
    radius = float(np.linalg.norm(used - centre, axis=1).max()) or 1.0
    mesh = _mesh(mi, surface, (surface.positions - centre) / radius, device)
    return PreparedSurface(
        mi=mi,
        scene=instantiate(device, {"type": "scene", "surface": mesh}),
        mesh=mesh,
        face_part=unsigned(mi, torch.tensor(surface.face_part), device),
        centre=centre,
        radius=radius,
        parts=tuple(part.name for part in surface.parts),
        repeat=surface.repeat,
        device=device,
    )


@dataclass(frozen=True, eq=False)
class Lens:
    """A camera in the prepared surface's coordinates; its axes are scaled to half the film's width and height."""

    mi: Any
    origin: Any
    right: Any
    top: Any
    forward: Any
    width: Any
    height: Any

    @classmethod
    def of(cls, prepared: PreparedSurface, view: View) -> Lens:
        """The view's camera."""
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

    def ray(self, pixel: Any, random: Any) -> Any:
        """Rays through pixels (row * width + column), `random` saying where in each."""
        mi = self.mi
        row = pixel // self.width
        col = pixel - row * self.width
        x = (mi.Float(col) + random.x) * (2.0 / mi.Float(self.width)) - 1.0
        y = 1.0 - (mi.Float(row) + random.y) * (2.0 / mi.Float(self.height))
        return mi.Ray3f(mi.Point3f(self.origin), dr.normalize(self.right * x + self.top * y + self.forward))


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
    mesh.initialize()  # and not `parameters_changed`, which makes normals by another rule than ours
    return mesh
