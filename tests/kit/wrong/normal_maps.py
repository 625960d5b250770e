"""Tangent frames, normals and horizons other than the conventions', and gradients of them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import torch
from svbrdfgan_numpy import materials, normal_map
from svbrdfgan_numpy.integrator import PathTracer
from svbrdfgan_numpy.normal_map import Frame
from svbrdfgan_numpy.vectors import cross, tangents
from torch import Tensor

from svbrdfgan.types import Gradients
from wrong.base import Call, OnNumpy, Patch, Patched, gradient_of, with_map
from wrong.table import caught_by

_TILTS = (
    "test_normals_tilt_towards_u_and_v",
    "test_normals_tilt_with_turned_uvs",
    "test_normals_tilt_with_mirrored_uvs",
    "test_relief_pushes_through",
    "test_normals_tilt_from_the_shading_normal",
    "test_normal_maps_lie_as_textures",
)


@caught_by(*_TILTS, whole=True, reason="On every plane.")
class GreenFlipped(OnNumpy):
    """+y is towards falling v, as in DirectX's normal maps."""

    def asked(self, call: Call) -> Call:
        return replace(call, materials=with_map(call.materials, "normal", _green_flipped))

    def gradient(self, gradients: Gradients, call: Call) -> Gradients:
        return gradient_of(gradients, "normal", _green_flipped)


def _green_flipped(normal: Tensor) -> Tensor:
    return normal * torch.tensor([1.0, -1.0, 1.0])


class FramedWrongly(Patched):
    """Its heirs have other tangent frames."""

    def axes(self, prepared: Any, points: Any, some: Any, right: Any) -> Any:
        """T, B and N, as (points, 3 axes, 3), from the right ones."""
        raise NotImplementedError

    def patches(self) -> list[Patch]:
        right = materials.frames_at

        def frames_at(prepared: Any, points: Any, some: Any) -> Frame:
            frame = right(prepared, points, some)
            return Frame(self.axes(prepared, points, some, frame.axes), frame.outgoing) if len(some) else frame

        return [(materials, "frames_at", frames_at)]


@caught_by("test_normals_tilt_with_mirrored_uvs")
class HandednessIgnored(FramedWrongly):
    """The bitangent is N x T, whether UVs are mirrored or not."""

    def axes(self, prepared: Any, points: Any, some: Any, right: Any) -> Any:
        handedness = prepared.tangents.handedness[points.face[some], None]
        return np.stack([right[:, 0], handedness * right[:, 1], right[:, 2]], axis=1)


@caught_by("test_normals_tilt_with_mirrored_uvs")
class TangentMirrored(FramedWrongly):
    """Where UVs are mirrored, T is turned over as well as B."""

    def axes(self, prepared: Any, points: Any, some: Any, right: Any) -> Any:
        handedness = prepared.tangents.handedness[points.face[some], None]
        return np.stack([handedness * right[:, 0], right[:, 1], right[:, 2]], axis=1)


@caught_by(
    "test_normals_tilt_with_turned_uvs",
    "test_normals_tilt_with_mirrored_uvs",
    "test_relief_pushes_through",
    "test_normals_tilt_from_the_shading_normal",
    reason="The first plane's axes are those of the world.",
)
class NormalsOfTheWorld(FramedWrongly):
    """Normal maps are read in the space of the object."""

    def axes(self, prepared: Any, points: Any, some: Any, right: Any) -> Any:
        return np.broadcast_to(np.eye(3), right.shape)


@caught_by("test_normals_tilt_with_turned_uvs", "test_normals_tilt_with_mirrored_uvs", reason="By luck not elsewhere.")
class TangentOfTheNormal(FramedWrongly):
    """The tangent is some direction that the normal determines, whatever the UVs."""

    def axes(self, prepared: Any, points: Any, some: Any, right: Any) -> Any:
        side = points.side[some, None]
        normal = side * points.normal[some]
        return np.stack([side * each for each in (*tangents(normal), normal)], axis=1)


@caught_by("test_relief_pushes_through")
class ReliefOnBothSides(FramedWrongly):
    """From behind, N alone is turned to the viewer, and not the whole normal."""

    def axes(self, prepared: Any, points: Any, some: Any, right: Any) -> Any:
        side = points.side[some, None]
        return np.stack([side * right[:, 0], side * right[:, 1], right[:, 2]], axis=1)


@caught_by("test_normals_tilt_from_the_shading_normal")
class TangentOfTheFace(FramedWrongly):
    """T and B lie in the face, and not perpendicular to the interpolated normal."""

    def axes(self, prepared: Any, points: Any, some: Any, right: Any) -> Any:
        face, geometric = points.face[some], points.geometric[some]
        flat = prepared.tangents.direction[face, 0]
        flat = flat - (flat * geometric).sum(axis=-1, keepdims=True) * geometric
        tangent = points.side[some, None] * flat / np.linalg.norm(flat, axis=-1, keepdims=True)
        bitangent = cross(geometric * np.sign((geometric * right[:, 2]).sum(axis=-1, keepdims=True)), tangent)
        sign = np.sign((bitangent * right[:, 1]).sum(axis=-1, keepdims=True))
        return np.stack([tangent, sign * bitangent, right[:, 2]], axis=1)


@caught_by(
    *_TILTS,
    "test_normals_are_looked_up_and_then_scaled",
    whole=True,
    reason="z does not count, so steep normals are less so.",
)
class NormalsAddedUp(FramedWrongly):
    """The normal is N + x T + y B, of which z says nothing: a height's slope, in effect."""

    def patches(self) -> list[Patch]:
        def flattened(self: Any, texel: Any) -> Any:
            return _scaled(
                np.einsum("pa,pac->pc", np.concatenate([texel[:, :2], np.ones((len(texel), 1))], 1), self.axes)
            )

        return [(Frame, "_unbent", flattened)]


@caught_by(
    "test_a_neutral_normal_changes_nothing",
    "test_normals_are_looked_up_and_then_scaled",
    *_TILTS[:-1],
    whole=True,
    reason="Where normals of other lengths are compared.",
)
class NormalsNotScaled(Patched):
    """Normals are as long as the map says."""

    def patches(self) -> list[Patch]:
        return [(Frame, "_unbent", lambda self, texel: np.einsum("pa,pac->pc", texel, self.axes))]


@caught_by(
    "test_normals_are_looked_up_and_then_scaled",
    "test_the_gradient_of_a_normal_is_perpendicular_to_it",
    whole=True,
    reason="In pictures between texels; the gradient is that of scaled texels.",
)
class ScaledBeforeLookup(OnNumpy):
    """Texels of normals are scaled to length one, before they are looked up."""

    def asked(self, call: Call) -> Call:
        return replace(call, materials=with_map(call.materials, "normal", _of_length_one))


@caught_by(
    "test_a_neutral_normal_changes_nothing",
    "test_the_gradient_of_a_normal_is_perpendicular_to_it",
    *_TILTS,
    whole=True,
    reason="No normal is what it was.",
)
class NormalsAsInFiles(OnNumpy):
    """Normals are read as if they were 0.5 + 0.5 (x, y, z)."""

    def asked(self, call: Call) -> Call:
        return replace(call, materials=with_map(call.materials, "normal", lambda normal: 2.0 * normal - 1.0))

    def gradient(self, gradients: Gradients, call: Call) -> Gradients:
        return gradient_of(gradients, "normal", lambda gradient: 2.0 * gradient)


@caught_by("test_no_light_comes_from_behind")
class LightFromBehind(Patched):
    """Light counts if the tilted normal leans to it, and comes through the surface where it is not shadowed."""

    def patches(self) -> list[Patch]:
        right = PathTracer._arrival

        def arrival(self: Any, points: Any, bsdf: Any, direction: Any, visible: Any, *, onward: bool) -> Any:
            return right(self, replace(points, normal=bsdf.normal), bsdf, direction, visible, onward=onward)

        return [(PathTracer, "_arrival", arrival)]


@caught_by("test_rims_are_not_black", whole=True)
class NormalsNotBent(Patched):
    """Normals that turn away from the viewer stay as they are."""

    def patches(self) -> list[Patch]:
        return [
            (normal_map._Bend, "bent", lambda self, normal: normal),
            (normal_map._Bend, "bent_vjp", lambda self, normal, grad: grad),
        ]


@caught_by("test_rims_are_not_black", whole=True)
class NormalsBentToTheSurface(Patched):
    """Normals that turn away from the viewer are replaced by the shading normal."""

    def patches(self) -> list[Patch]:
        def bent(self: Any, normal: Any) -> Any:
            return np.where((self.e > 0.0)[:, None], self.frame.axes[:, 2], normal)

        return [(normal_map._Bend, "bent", bent)]


@caught_by("test_the_gradient_of_a_normal_is_perpendicular_to_it", whole=True)
class NormalGradientNotProjected(Patched):
    """The gradient of a normal is that of one that need not be of length one."""

    def patches(self) -> list[Patch]:
        def vjp(self: Any, texel: Any, grad: Any) -> Any:
            unbent = normal_map._Bend.of(self, self._unbent(texel)).bent_vjp(self._unbent(texel), grad)
            return np.einsum("pac,pc->pa", self.axes, unbent)

        return [(Frame, "tilted_vjp", vjp)]


@caught_by("test_normal_gradients_of_bent_normals")
class NormalGradientNotBent(Patched):
    """The gradient of a bent normal is that of the normal that it is bent to."""

    def patches(self) -> list[Patch]:
        return [(normal_map._Bend, "bent_vjp", lambda self, normal, grad: grad)]


@caught_by("test_the_gradient_of_the_normal_in_total", late=True, reason="Too little for any texel alone.")
class NormalGradientTooSteep(OnNumpy):
    """The gradient of the normal is 2 % too large."""

    def gradient(self, gradients: Gradients, call: Call) -> Gradients:
        return gradient_of(gradients, "normal", lambda gradient: 1.02 * gradient)


def _scaled(vectors: Any) -> Any:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def _of_length_one(normal: Tensor) -> Tensor:
    return torch.nn.functional.normalize(normal, dim=-1)
