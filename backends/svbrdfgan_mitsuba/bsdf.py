"""The BSDFs at many points at once: Lambertian, and glTF's metallic-roughness material (`docs/conventions.md`).

Directions are unit vectors away from the surface, all in one frame, whose z axis is the interpolated shading normal N,
turned to the viewer. The normal n about which a point reflects is a vector in this frame: the z axis itself where no
part has a normal map. N only decides which directions are above the horizon, and that is the caller's business.

`value` is the BSDF times the cosine n.w_i, and differentiable. `sample` and `density` are only called with values that
have no gradient: gradients treat drawn directions as constants, and a density that followed a map would bias them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

from svbrdfgan.types import DIELECTRIC_REFLECTANCE, LEAST_ROUGHNESS
from svbrdfgan_mitsuba.interop import dr

GLOSS = (0.25, 0.75)
"""Share of the directions at glossy points that are drawn from the gloss: of a dielectric, which reflects little, and
of a metal. A metal has no diffuse lobe, but its gradient with respect to `metallic` is that of one."""

EVEN = 0.1
"""Share of the diffuse directions that are drawn evenly where there are normal maps. The gradient in a normal does not
vanish at its horizon as the cosine does: drawn by the cosine alone, its variance on paths would be infinite."""


class Bsdf(Protocol):
    """The reflection of light at points: its value, and directions drawn accordingly."""

    def sample(self, choice: Any, random: Any) -> Any:
        """A direction, drawn by a number and a pair of numbers in [0, 1); possibly below a horizon."""

    def density(self, incoming: Any) -> Any:
        """The density of `sample`, per steradian, above the horizon of n."""

    def value(self, incoming: Any) -> Any:
        """The BSDF times the cosine; zero below the horizon of n."""


@dataclass(frozen=True, eq=False)
class Lambertian:
    """base_color / pi.

    Attributes:
        normal: n, or None for the z axis.
    """

    mi: Any
    base_color: Any
    normal: Any | None

    def sample(self, choice: Any, random: Any) -> Any:
        return _to_frame(self.mi, self.normal, _drawn_diffusely(self.mi, self.normal, choice, random))

    def density(self, incoming: Any) -> Any:
        return _diffuse_density(self.normal, incoming)

    def value(self, incoming: Any) -> Any:
        return self.base_color * (dr.maximum(cosine(self.normal, incoming), 0.0) * dr.inv_pi)


@dataclass(frozen=True, eq=False)
class MetallicRoughness:
    """The mixture of a dielectric and a metal, or Lambertian where not `glossy`.

    Attributes:
        normal: n, or None for the z axis.
        roughness: as read from the map, not yet bounded below.
        metallic: None for zero.
        glossy: whether the point's part has a roughness.
        viewer: direction to the viewer; its z is not negative.
    """

    mi: Any
    base_color: Any
    normal: Any | None
    roughness: Any
    metallic: Any | None
    glossy: Any
    viewer: Any

    def sample(self, choice: Any, random: Any) -> Any:
        again = (choice - self._share) / (1.0 - self._share)  # uniform where the gloss was not chosen
        drawn = _drawn_diffusely(self.mi, self.normal, again, random)
        viewer = self.viewer if self.normal is None else self.mi.Frame3f(self.normal).to_local(self.viewer)
        mirrored = self.mi.reflect(viewer, _visible_facet(self.mi, viewer, self._alpha, random))
        return _to_frame(self.mi, self.normal, dr.select(choice < self._share, mirrored, drawn))

    def density(self, incoming: Any) -> Any:
        diffuse = _diffuse_density(self.normal, incoming)
        # Of visible facets, G1 D (w_o.h) / (n.w_o), over the Jacobian 4 (w_o.h) of the reflection.
        mirrored = self._facets(self._half(incoming)) * self._visible(self._toward_viewer) / 4.0
        return dr.lerp(diffuse, mirrored, self._share)

    def value(self, incoming: Any) -> Any:
        toward, half = dr.maximum(cosine(self.normal, incoming), 0.0), self._half(incoming)
        p = dr.power(dr.maximum(1.0 - dr.dot(half, self.viewer), 0.0), 5)
        fresnel = dr.lerp(DIELECTRIC_REFLECTANCE, 1.0, p)
        masking = self._visible(self._toward_viewer) * self._visible(toward)
        lobe = self._facets(half) * masking * toward / 4.0  # D G / (4 |n.w_o| |n.w_i|), times the cosine
        diffuse = toward * dr.inv_pi
        tinted, white = (1.0 - fresnel) * diffuse, fresnel * lobe
        if self.metallic is not None:
            tinted = dr.lerp(tinted, (1.0 - p) * lobe, self.metallic)
            white = dr.lerp(white, p * lobe, self.metallic)
        return self.base_color * dr.select(self.glossy, tinted, diffuse) + dr.select(self.glossy, white, 0.0)

    @property
    def _toward_viewer(self) -> Any:
        return dr.maximum(cosine(self.normal, self.viewer), 0.0)

    @property
    def _share(self) -> Any:
        """The share of directions that are drawn from the gloss: none where n is turned away and shows no facet."""
        metallic = self.mi.Float(0.0) if self.metallic is None else dr.clip(self.metallic, 0.0, 1.0)
        return dr.select(self.glossy & (cosine(self.normal, self.viewer) >= 0.0), dr.lerp(*GLOSS, metallic), 0.0)

    @property
    def _alpha(self) -> Any:
        return dr.square(dr.maximum(self.roughness, LEAST_ROUGHNESS))

    def _half(self, incoming: Any) -> Any:
        return dr.normalize(self.viewer + incoming)

    def _facets(self, half: Any) -> Any:
        """D: the density of facets that face `half`."""
        squared = dr.square(self._alpha)
        along = cosine(self.normal, half)
        across = (
            half.x * half.x + half.y * half.y if self.normal is None else dr.squared_norm(dr.cross(self.normal, half))
        )
        # The sine does not come from the cosine, which would cancel: at the least roughness, lobes are 0.0025 wide.
        spread = dr.fma(squared, along * along, across)
        return dr.select(along > 0.0, squared * dr.inv_pi / dr.square(spread), 0.0)

    def _visible(self, cosine: Any) -> Any:
        """G1 / cosine: Smith's masking, divided by what it tends to."""
        squared = dr.square(self._alpha)
        return 2.0 / (cosine + dr.sqrt(dr.fma(1.0 - squared, cosine * cosine, squared)))


def cosine(normal: Any | None, direction: Any) -> Any:
    """The cosine of the angle between the normal, or the z axis, and a direction."""
    return direction.z if normal is None else dr.dot(normal, direction)


def _drawn_diffusely(mi: Any, normal: Any | None, choice: Any, random: Any) -> Any:
    """A direction about the z axis."""
    by_cosine = mi.warp.square_to_cosine_hemisphere(random)
    if normal is None:
        return by_cosine
    return dr.select(choice < EVEN, mi.warp.square_to_uniform_hemisphere(random), by_cosine)


def _diffuse_density(normal: Any | None, incoming: Any) -> Any:
    """The density of directions drawn diffusely, per steradian; zero below the horizon of the normal."""
    toward = cosine(normal, incoming)
    by_cosine = dr.maximum(toward, 0.0) * dr.inv_pi
    if normal is None:
        return by_cosine
    return dr.lerp(by_cosine, dr.select(toward > 0.0, 0.5 * dr.inv_pi, 0.0), EVEN)


def _to_frame(mi: Any, normal: Any | None, direction: Any) -> Any:
    """A direction about the z axis, turned to be about the normal."""
    return direction if normal is None else mi.Frame3f(normal).to_world(direction)


def _visible_facet(mi: Any, viewer: Any, alpha: Any, random: Any) -> Any:
    """The normal of a facet that the viewer sees, about the z axis.

    Stretched to a hemisphere, the facets mirror the viewer's direction evenly into a spherical cap (Dupuy and Benyoub,
    "Sampling Visible GGX Normals with Spherical Caps", 2023).
    """
    stretched = dr.normalize(mi.Vector3f(alpha * viewer.x, alpha * viewer.y, dr.maximum(viewer.z, 0.0)))
    z = dr.fma(1.0 - random.y, 1.0 + stretched.z, -stretched.z)
    sine, cosine = dr.sincos(2.0 * dr.pi * random.x)
    radius = dr.safe_sqrt(1.0 - z * z)
    half = mi.Vector3f(radius * cosine + stretched.x, radius * sine + stretched.y, z + stretched.z)
    return dr.normalize(mi.Vector3f(alpha * half.x, alpha * half.y, dr.maximum(half.z, 0.0)))
