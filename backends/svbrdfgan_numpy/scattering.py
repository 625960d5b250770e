"""What a surface makes of light, as far as the values of its maps have no say: which directions a path takes from it.

A point is Lambertian, or glossy where its part's material has `roughness`. At a glossy point half of the directions are
drawn as if it were Lambertian, half by its gloss.
"""

from __future__ import annotations

from dataclasses import dataclass

from jaxtyping import Float, Int
from numpy import ndarray

from svbrdfgan_numpy import diffuse, glossy
from svbrdfgan_numpy.glossy import Cosines
from svbrdfgan_numpy.surface import Points


@dataclass(frozen=True, eq=False)
class Scattering:
    """How light from one direction at each point is scattered to the path.

    The BSDF times the cosine is `base_color * diffuse`, plus `gloss * lobe(cosines, alpha)` at glossy points.

    Attributes:
        diffuse: per unit of base colour.
        gloss: the Fresnel reflectance, at glossy points only.
        cosines: at glossy points only.
        density: of the direction in `sample`, per steradian; 0 behind the surface, where light does not count.
    """

    diffuse: Float[ndarray, " points"]
    gloss: Float[ndarray, " glossy"]
    cosines: Cosines
    density: Float[ndarray, " points"]


def scatter(points: Points, shiny: Int[ndarray, " glossy"], incoming: Float[ndarray, "points 3"]) -> Scattering:
    """The scattering of light from a direction at each point, those numbered by `shiny` being glossy."""
    reflected, density = diffuse.evaluate(points.normal, incoming), diffuse.pdf(points.normal, incoming)
    cosines = glossy.cosines_between(points.normal[shiny], points.outgoing[shiny], incoming[shiny])
    gloss = glossy.fresnel(cosines)
    reflected[shiny] *= 1.0 - gloss
    density[shiny] = 0.5 * (density[shiny] + glossy.pdf(cosines))
    return Scattering(reflected, gloss, cosines, density)


def sample(
    points: Points, shiny: Int[ndarray, " glossy"], random: Float[ndarray, "points 2"]
) -> Float[ndarray, "points 3"]:
    """Unit directions, drawn as the points reflect. The first number also chooses between diffuse and gloss."""
    by_gloss = shiny[random[shiny, 0] < 0.5]
    random = random.copy()
    random[shiny, 0] = 2.0 * random[shiny, 0] % 1.0
    direction = diffuse.sample(points.normal, random)
    direction[by_gloss] = glossy.sample(points.normal[by_gloss], points.outgoing[by_gloss], random[by_gloss])
    return direction
