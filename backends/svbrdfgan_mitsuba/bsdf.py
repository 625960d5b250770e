"""The BSDFs at many points at once: Lambertian, and glTF's dielectric (`docs/conventions.md`).

Directions are unit vectors away from the surface, in the frame of the shading normal turned to the viewer. `value` is
the BSDF times the cosine, and differentiable. `sample` and `density` are detached: gradients treat drawn directions as
constants, and a density that followed the roughness would bias them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

from svbrdfgan.types import DIELECTRIC_REFLECTANCE, LEAST_ROUGHNESS
from svbrdfgan_mitsuba.interop import dr, mitsuba

GLOSS = 0.25
"""Share of the directions at glossy points that are drawn from the gloss. It reflects little: F0 is 0.04."""


class Bsdf(Protocol):
    """How a point reflects light."""

    def sample(self, choice: Any, random: Any) -> Any:
        """A direction, drawn by a number and a pair of numbers in [0, 1)."""
        ...

    def density(self, incoming: Any) -> Any:
        """The density of `sample`, per steradian."""
        ...

    def value(self, incoming: Any) -> Any:
        """The BSDF times the cosine; zero below the surface."""
        ...


@dataclass(frozen=True, eq=False)
class Lambertian:
    """base_color / pi."""

    mi: Any
    base_color: Any

    def sample(self, choice: Any, random: Any) -> Any:
        return self.mi.warp.square_to_cosine_hemisphere(random)

    def density(self, incoming: Any) -> Any:
        return dr.maximum(incoming.z, 0.0) * dr.inv_pi

    def value(self, incoming: Any) -> Any:
        return self.base_color * (dr.maximum(incoming.z, 0.0) * dr.inv_pi)


@dataclass(frozen=True, eq=False)
class Dielectric:
    """f = (1 - F) base_color / pi + F D G / (4 |n.w_o| |n.w_i|), or Lambertian where not `glossy`.

    Attributes:
        roughness: as read from the map, not yet bounded below.
        glossy: whether the point's part has a roughness.
        viewer: direction to the viewer; its z is not negative.
    """

    mi: Any
    base_color: Any
    roughness: Any
    glossy: Any
    viewer: Any

    def sample(self, choice: Any, random: Any) -> Any:
        normal = self._facets(dr.detach(self.roughness)).sample(self.viewer, random)[0]
        mirrored = self.mi.reflect(self.viewer, normal)
        diffuse = self.mi.warp.square_to_cosine_hemisphere(random)
        return dr.select(self.glossy & (choice < GLOSS), mirrored, diffuse)

    def density(self, incoming: Any) -> Any:
        half, facing = self._half(incoming)
        facets = self._facets(dr.detach(self.roughness))
        viewer = self.mi.Vector3f(self.viewer.x, self.viewer.y, dr.maximum(self.viewer.z, 1e-7))  # `pdf` divides by z
        mirrored = facets.pdf(viewer, half) / (4.0 * dr.maximum(facing, 1e-12))
        diffuse = dr.maximum(incoming.z, 0.0) * dr.inv_pi
        mixed = dr.lerp(diffuse, dr.select(facing > 0.0, mirrored, 0.0), GLOSS)
        return dr.select(self.glossy, mixed, diffuse)

    def value(self, incoming: Any) -> Any:
        half, facing = self._half(incoming)
        cosine = dr.maximum(incoming.z, 0.0)
        grazing = dr.power(dr.maximum(1.0 - facing, 0.0), 5)
        fresnel = dr.lerp(DIELECTRIC_REFLECTANCE, 1.0, grazing)
        fresnel = dr.select(self.glossy, fresnel, 0.0)
        facets = self._facets(self.roughness)
        shape = facets.eval(half) * facets.G(self.viewer, incoming, half)
        mirrored = fresnel * shape / (4.0 * dr.maximum(self.viewer.z, 1e-7))  # the cosine to the light cancels
        lit = (cosine > 0.0) & (self.viewer.z > 0.0)
        diffuse = self.base_color * ((1.0 - fresnel) * cosine * dr.inv_pi)
        return diffuse + dr.select(lit & self.glossy, mirrored, 0.0)

    def _half(self, incoming: Any) -> tuple[Any, Any]:
        """The half vector, and its cosine with either direction."""
        half = dr.normalize(self.viewer + incoming)
        return half, dr.dot(half, self.viewer)

    def _facets(self, roughness: Any) -> Any:
        alpha = dr.square(dr.maximum(roughness, LEAST_ROUGHNESS))
        return self.mi.MicrofacetDistribution(mitsuba.MicrofacetType.GGX, alpha)
