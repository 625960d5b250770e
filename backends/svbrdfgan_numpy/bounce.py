"""What paths leave behind at their vertices: all that shading needs, and nothing that depends on values of maps."""

from __future__ import annotations

from dataclasses import dataclass

from jaxtyping import Float, Int
from numpy import ndarray

from svbrdfgan_numpy.glossy import Cosines
from svbrdfgan_numpy.taps import Taps


@dataclass(frozen=True, eq=False)
class Reflection:
    """One summand of the light that leaves some vertices: value * (light + onward * what the path meets next).

    The value is the only factor that depends on materials: the base colour, or the lobe of a gloss.

    Attributes:
        vertex: index into the bounce's vertices, none twice.
        light: the light gathered there, per unit of value, as a sum over the environment's pixels.
        onward: the weight of what the path goes on to, per unit of value.
    """

    vertex: Int[ndarray, " some"]
    light: Taps
    onward: Float[ndarray, " some"]


@dataclass(frozen=True, eq=False)
class Gloss:
    """A reflection whose value is `glossy.lobe` of these cosines."""

    cosines: Cosines
    reflection: Reflection


@dataclass(frozen=True, eq=False)
class Bounce:
    """The vertices of many paths at one depth; a path that has left the scene has none.

    Attributes:
        path: which of the paths each vertex belongs to, no path twice.
        part: index into the surface's parts.
        uv: texture coordinates.
        diffuse: at all vertices, from both directions; its value is the base colour.
        gloss: at glossy vertices, one from each direction.
    """

    path: Int[ndarray, " vertices"]
    part: Int[ndarray, " vertices"]
    uv: Float[ndarray, "vertices 2"]
    diffuse: Reflection
    gloss: tuple[Gloss, ...]

    @property
    def reflections(self) -> tuple[Reflection, ...]:
        """All the summands, the diffuse one first."""
        return (self.diffuse, *(gloss.reflection for gloss in self.gloss))
