"""Surfaces with one side, with other normals, and with another part's material."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from svbrdfgan.types import Gradients, Material, Materials, Surface, TransportSamples
from wrong.base import Call, Right
from wrong.table import caught_by


@caught_by("test_surfaces_have_two_sides", "test_winding_does_not_matter", reason="It goes by winding.")
class BlackFromBehind(Right):
    """What turns its back to the camera is black."""

    def asked(self, call: Call) -> Call:
        black = call.surface.parts[0]
        surface = replace(
            call.surface,
            parts=(*call.surface.parts, replace(black, name="black")),
            face_part=np.where(self.back(call), len(call.surface.parts), call.surface.face_part),
        )
        materials = Materials((*call.materials.parts, Material.lambertian((0.0, 0.0, 0.0))))
        return replace(call, prepared=self.right.prepare(surface), materials=materials)

    def back(self, call: Call) -> np.ndarray:
        """Which faces do so, by their winding."""
        a, b, c = np.moveaxis(call.surface.positions[call.surface.faces], 1, 0)
        return self.away(np.cross(b - a, c - a), call)

    def away(self, normal: np.ndarray, call: Call) -> np.ndarray:
        corner = call.surface.positions[call.surface.faces[:, 0]]
        return ((np.array(call.view.camera.origin) - corner) * normal).sum(axis=1) < 0.0

    def gradient(self, gradients: Gradients, call: Call) -> Gradients:
        return replace(gradients, materials=gradients.materials[:-1])

    def samples(self, samples: TransportSamples, call: Call) -> TransportSamples:
        last = len(call.surface.parts)
        dark = samples.part == last
        weight = torch.where(dark[:, None], 0.0, samples.weight)
        return replace(samples, part=torch.where(dark, 0, samples.part), weight=weight)


@caught_by("test_surfaces_have_two_sides")
class BlackFromBehindByNormals(BlackFromBehind):
    """What turns its vertex normals away from the camera is black."""

    def back(self, call: Call) -> np.ndarray:
        return self.away(call.surface.normals[call.surface.faces].sum(axis=1), call)


class WithoutSmoothShading(Right):
    """Each face with vertices of its own, and one normal."""

    def surface(self, surface: Surface) -> Surface:
        vertex = surface.faces.reshape(-1)
        own = {name: getattr(surface, name)[vertex] for name in ("positions", "uv", "elevation")}
        normals = self.normals(surface)
        normals = np.repeat(normals / np.linalg.norm(normals, axis=1, keepdims=True), 3, axis=0)
        return replace(surface, faces=np.arange(len(vertex)).reshape(-1, 3), normals=normals, **own)

    def normals(self, surface: Surface) -> np.ndarray:
        return surface.normals[surface.faces].sum(axis=1)


@caught_by("test_shading_normals_are_interpolated")
class FlatShading(WithoutSmoothShading):
    """The mean of the vertex normals over the whole face."""


@caught_by(
    "test_shading_normals_shade",
    "test_shading_normals_are_interpolated",
    reason="Those of vertices are not looked at, whether all are alike or not.",
)
class FaceNormals(WithoutSmoothShading):
    """The face's own normal instead of the vertices'."""

    def normals(self, surface: Surface) -> np.ndarray:
        a, b, c = np.moveaxis(surface.positions[surface.faces], 1, 0)
        normals = np.cross(b - a, c - a)
        degenerate = np.linalg.norm(normals, axis=1, keepdims=True) == 0.0
        return np.where(degenerate, [0.0, 0.0, 1.0], normals)


@caught_by(
    "test_each_part_has_its_own_material",
    "test_unseen_texels_have_no_gradient",
    whole=True,
    reason="The part in front has the hidden one's.",
)
class MaterialsInReverse(Right):
    """Parts are listed in another order than the surface's."""

    def asked(self, call: Call) -> Call:
        return replace(call, materials=Materials(call.materials.parts[::-1]))

    def gradient(self, gradients: Gradients, call: Call) -> Gradients:
        return replace(gradients, materials=gradients.materials[::-1])

    def samples(self, samples: TransportSamples, call: Call) -> TransportSamples:
        return replace(samples, part=len(call.surface.parts) - 1 - samples.part)
