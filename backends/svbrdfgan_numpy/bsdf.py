"""The materials of `docs/conventions.md` at points, their derivatives, and directions drawn by them.

A point is Lambertian, or glossy where its part's material has `roughness`. At glossy points the BSDF is
f = (1 - m) (1 - F_d) base_color / pi + F S, with m the metallic, S = D G / (4 |n . w_o| |n . w_i|) and
F = (1 - m) F_d + m (base_color + (1 - base_color) p). Directions point away from the surface.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from svbrdfgan.types import DIELECTRIC_REFLECTANCE, LEAST_ROUGHNESS
from svbrdfgan_numpy import ggx
from svbrdfgan_numpy.ggx import PerPoint
from svbrdfgan_numpy.vectors import dot, from_frame, normalize

Vectors = Float[ndarray, "points 3"]
Rgb = Float[ndarray, "points 3"]

EVEN = 0.1
"""Share of the diffuse directions that are drawn evenly where there are normal maps. The gradient in a normal does not
vanish at its horizon as the cosine does: drawn by the cosine alone, its variance on paths would be infinite."""


@dataclass(frozen=True, eq=False)
class BsdfGradient:
    """The gradient of a sum over points in the values of `Bsdf`; zero for those that do not enter."""

    base_color: Rgb
    roughness: PerPoint
    metallic: PerPoint
    normal: Vectors

    def __add__(self, other: BsdfGradient) -> BsdfGradient:
        return BsdfGradient(
            self.base_color + other.base_color,
            self.roughness + other.roughness,
            self.metallic + other.metallic,
            self.normal + other.normal,
        )


@dataclass(frozen=True, eq=False)
class Bsdf:
    """The material at some points.

    Attributes:
        glossy: the points that are not Lambertian. The others' roughness and metallic count for nothing.
        base_color: linear reflectance.
        roughness: before it is bounded.
        metallic: 0 to 1.
        normal: unit normal n, tilted by the normal map.
        mapped: the points that have a normal map.
    """

    glossy: Int[ndarray, " glossy"]
    base_color: Rgb
    roughness: PerPoint
    metallic: PerPoint
    normal: Vectors
    mapped: Int[ndarray, " mapped"]

    def evaluate(self, outgoing: Vectors, incoming: Vectors) -> Rgb:
        """The BSDF times n . w_i, per steradian; 0 where the light comes from behind n."""
        cosine, some = np.maximum(dot(self.normal, incoming), 0.0), self.glossy
        value = self.base_color / np.pi
        value[some] = self._facets(outgoing, incoming).bsdf(self.base_color[some], self.metallic[some, None])
        return cosine[:, None] * value

    def evaluate_vjp(self, outgoing: Vectors, incoming: Vectors, grad: Rgb) -> BsdfGradient:
        """The gradient of sum(evaluate * grad) in the material, directions being constant."""
        cosine, some, facets = dot(self.normal, incoming), self.glossy, self._facets(outgoing, incoming)
        color, metallic = self.base_color[some], self.metallic[some, None]
        front = cosine > 0.0
        grad = np.where(front[:, None], grad, 0.0)
        grad_bsdf = cosine[:, None] * grad
        bsdf, of_color = self.base_color / np.pi, np.full_like(grad, 1.0 / np.pi)
        bsdf[some], of_color[some] = facets.bsdf(color, metallic), facets.slope_in_color(metallic)
        normal = (grad * bsdf).sum(axis=-1, keepdims=True) * incoming
        grad_specular = (grad_bsdf[some] * facets.reflectance(color, metallic)).sum(axis=-1)
        in_normal, in_alpha2 = facets.specular_slopes()
        normal[some] += grad_specular[:, None] * in_normal
        roughness, of_metallic = np.zeros(len(grad)), np.zeros(len(grad))
        roughness[some] = grad_specular * in_alpha2 * _alpha2_slope(self.roughness[some])
        of_metallic[some] = (grad_bsdf[some] * facets.slope_in_metallic(color)).sum(axis=-1)
        return BsdfGradient(grad_bsdf * of_color, roughness, of_metallic, normal)

    def sample(self, outgoing: Vectors, random: Float[ndarray, "points 2"]) -> Vectors:
        """Unit directions about as the points scatter, by facets or diffusely; they may be below the surface."""
        by_facets, first = _chosen(random[:, 0], self._share_of_facets(outgoing))
        evenly, number = _chosen(first, self._share_of_even())
        sine2 = np.where(evenly, 1.0 - number**2, number)  # even in the cosine, or in its square
        direction = from_frame(self.normal, sine2, 2.0 * np.pi * random[:, 1])
        some, alpha2 = np.flatnonzero(by_facets), _alpha2(self.roughness[by_facets])
        numbers = np.stack([first, random[:, 1]], axis=-1)[some]
        direction[some] = ggx.sample(self.normal[some], outgoing[some], alpha2, numbers)
        return direction

    def pdf(self, outgoing: Vectors, incoming: Vectors) -> PerPoint:
        """The density of `sample`, per steradian; 0 behind n, where light is ignored."""
        cosine, share, some = dot(self.normal, incoming), self._share_of_facets(outgoing), self.glossy
        # The Lambertian BSDF times the cosine equals the density of cosine sampling, so a diffuse path goes on weighted
        # by the base colour alone.
        even = self._share_of_even()
        density = (1.0 - share) * ((1.0 - even) * np.maximum(cosine, 0.0) + 0.5 * even) / np.pi
        facets = self._facets(outgoing, incoming)
        density[some] += share[some] * ggx.pdf(facets.outgoing, facets.half, facets.alpha2)
        return np.where(cosine > 0.0, density, 0.0)

    def _share_of_facets(self, outgoing: Vectors) -> PerPoint:
        """The probability of drawing by facets, which must not depend on the base colour.

        A metal has no diffuse lobe, but its gradient in `metallic` has one: some directions are always for that. A
        viewer behind n sees no facets to draw by.
        """
        share, some = np.zeros(len(outgoing)), self.glossy
        share[some] = 0.5 + 0.4 * np.clip(self.metallic[some], 0.0, 1.0)
        return np.where(dot(self.normal, outgoing) >= 0.0, share, 0.0)

    def _share_of_even(self) -> PerPoint:
        """The probability of drawing a diffuse direction evenly over the hemisphere, and not by the cosine."""
        share = np.zeros(len(self.normal))
        share[self.mapped] = EVEN
        return share

    def _facets(self, outgoing: Vectors, incoming: Vectors) -> _Facets:
        some = self.glossy
        return _Facets.between(self.normal[some], outgoing[some], incoming[some], _alpha2(self.roughness[some]))


@dataclass(frozen=True, eq=False)
class _Facets:
    """The facets that reflect from one direction into another at glossy points, whatever their colour and metallic.

    Attributes:
        towards: w_i, w_o and h, the unit vector halfway between them.
        incoming, outgoing, half: the cosines of `towards` to n; negative ones count as 0.
        alpha2: the fourth power of the bounded roughness.
        schlick: p = (1 - w_o . h)^5.
    """

    towards: tuple[Vectors, Vectors, Vectors]
    incoming: PerPoint
    outgoing: PerPoint
    half: PerPoint
    alpha2: PerPoint
    schlick: Float[ndarray, "points 1"]

    @classmethod
    def between(cls, normal: Vectors, outgoing: Vectors, incoming: Vectors, alpha2: PerPoint) -> _Facets:
        towards = (incoming, outgoing, normalize(outgoing + incoming, fallback=normal))
        in_cosine, out_cosine, half = (np.maximum(dot(normal, direction), 0.0) for direction in towards)
        schlick = (1.0 - np.clip(dot(outgoing, towards[2]), 0.0, 1.0)) ** 5
        return cls(towards, in_cosine, out_cosine, half, alpha2, schlick[:, None])

    @property
    def dielectric(self) -> Float[ndarray, "points 1"]:
        """F_d, the share of light that a dielectric reflects without its colour."""
        return DIELECTRIC_REFLECTANCE + (1.0 - DIELECTRIC_REFLECTANCE) * self.schlick

    @property
    def specular(self) -> Float[ndarray, "points 1"]:
        """S, the BSDF of perfectly reflecting facets."""
        smith = ggx.masking(self.outgoing, self.alpha2) * ggx.masking(self.incoming, self.alpha2)
        return (0.25 * ggx.distribution(self.half, self.alpha2) * smith)[:, None]

    def specular_slopes(self) -> tuple[Vectors, PerPoint]:
        """The gradient of S in the normal, as if it need not be of unit length, and in alpha squared."""
        slopes = [
            ggx.masking_slopes(self.incoming, self.alpha2),
            ggx.masking_slopes(self.outgoing, self.alpha2),
            ggx.distribution_slopes(self.half, self.alpha2),
        ]
        cosines = (self.incoming, self.outgoing, self.half)
        in_normal = sum(
            np.where(cosine > 0.0, slope[0], 0.0)[:, None] * towards
            for cosine, slope, towards in zip(cosines, slopes, self.towards, strict=True)
        )
        return self.specular * in_normal, self.specular[:, 0] * sum(slope[1] for slope in slopes)

    def reflectance(self, color: Rgb, metallic: Float[ndarray, "points 1"]) -> Rgb:
        """F, the share of light that the facets reflect."""
        tinted = color + (1.0 - color) * self.schlick
        return (1.0 - metallic) * self.dielectric + metallic * tinted

    def bsdf(self, color: Rgb, metallic: Float[ndarray, "points 1"]) -> Rgb:
        """f."""
        diffuse = (1.0 - metallic) * (1.0 - self.dielectric) * color / np.pi
        return diffuse + self.reflectance(color, metallic) * self.specular

    def slope_in_color(self, metallic: Float[ndarray, "points 1"]) -> Float[ndarray, "points 1"]:
        """The derivative of f in the base colour, the same for each channel."""
        diffuse = (1.0 - metallic) * (1.0 - self.dielectric) / np.pi
        return diffuse + metallic * (1.0 - self.schlick) * self.specular

    def slope_in_metallic(self, color: Rgb) -> Rgb:
        """The derivative of f in metallic, in which it is linear."""
        one = np.ones_like(self.schlick)
        return self.bsdf(color, one) - self.bsdf(color, 0.0 * one)


def _chosen(number: PerPoint, share: PerPoint) -> tuple[Bool[ndarray, " points"], PerPoint]:
    """Whether a number of [0, 1) falls into the share, and a number that is uniform again within that choice."""
    chosen = number < share
    start, width = np.where(chosen, 0.0, share), np.where(chosen, share, 1.0 - share)
    return chosen, np.minimum((number - start) / width, 1.0)  # rounding could exceed 1, and sines of it be NaN


def _alpha2(roughness: PerPoint) -> PerPoint:
    return np.maximum(roughness, LEAST_ROUGHNESS) ** 4


def _alpha2_slope(roughness: PerPoint) -> PerPoint:
    return np.where(roughness < LEAST_ROUGHNESS, 0.0, 4.0 * roughness**3)
