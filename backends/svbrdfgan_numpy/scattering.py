"""How surface points scatter light, apart from the values of their maps, and which directions paths take from them.

A point is Lambertian, or glossy where its part's material has `roughness`. At glossy points half of the directions are
drawn by the cosine, half by the gloss. No map value enters, so that paths do not change when maps do.

Directions point away from the surface; the normal is the shading normal, turned to the viewer.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from svbrdfgan_numpy import glossy
from svbrdfgan_numpy.glossy import Cosines
from svbrdfgan_numpy.surface import Points
from svbrdfgan_numpy.vectors import dot, from_frame


@dataclass(frozen=True, eq=False)
class Scattering:
    """How each point scatters light from one direction along the path.

    The BSDF times the cosine is `base_color * diffuse`, plus `gloss * lobe(cosines, alpha)` at glossy points.

    Attributes:
        diffuse: per unit of base colour.
        gloss: the Fresnel reflectance, at glossy points only.
        cosines: at glossy points only.
        density: with which `sample` draws the direction, per steradian; 0 behind the surface, where light is ignored.
    """

    diffuse: Float[ndarray, " points"]
    gloss: Float[ndarray, " glossy"]
    cosines: Cosines
    density: Float[ndarray, " points"]


def scatter(points: Points, shiny: Int[ndarray, " glossy"], incoming: Float[ndarray, "points 3"]) -> Scattering:
    """The scattering of light from one direction at each point; `shiny` are the indices of the glossy points."""
    lambertian = np.maximum(dot(points.normal, incoming), 0.0) / np.pi
    # The Lambertian BSDF times the cosine equals the density of cosine sampling, so a diffuse path goes on weighted by
    # the base colour alone.
    reflected, density = lambertian, lambertian.copy()
    cosines = glossy.cosines_between(points.normal[shiny], points.outgoing[shiny], incoming[shiny])
    gloss = glossy.fresnel(cosines)
    reflected[shiny] *= 1.0 - gloss
    density[shiny] = 0.5 * (density[shiny] + glossy.pdf(cosines))
    return Scattering(reflected, gloss, cosines, density)


def sample(
    points: Points, shiny: Int[ndarray, " glossy"], random: Float[ndarray, "points 2"]
) -> Float[ndarray, "points 3"]:
    """Unit directions, drawn as the points scatter. The first number also chooses between diffuse and gloss."""
    by_gloss = shiny[random[shiny, 0] < 0.5]
    random = random.copy()
    random[shiny, 0] = 2.0 * random[shiny, 0] % 1.0  # the half that chose is a uniform number again
    direction = from_frame(points.normal, random[:, 0], 2.0 * np.pi * random[:, 1])
    direction[by_gloss] = glossy.sample(points.normal[by_gloss], points.outgoing[by_gloss], random[by_gloss])
    return direction
