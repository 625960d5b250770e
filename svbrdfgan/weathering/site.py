"""The geometry that weathering recipes use: position, normal, visibility and curvature at each texel."""

from __future__ import annotations

from dataclasses import dataclass, replace

from jaxtyping import Float, Int
from numpy import ndarray


@dataclass(frozen=True, eq=False)
class Site:
    """Geometry at each texel, independent of the model's size and location.

    Attributes:
        position: in lengths of the model; x (left) and z (nose) from the centre, y from the ground.
        height: height above the ground in heights of the model, 0 to 1.
        normal: unit normal, outward.
        visibility: ambient-occlusion visibility: 1 is unoccluded, 0 is enclosed.
        curvature: scaled mean curvature: positive on edges, negative in creases, about 1 at a right angle.
        axles: z of the wheels, in the units of `position`.
        texel: the side of a texel, in the units of `position`: recipes paint nothing finer.
    """

    position: Float[ndarray, "texels 3"]
    height: Float[ndarray, " texels"]
    normal: Float[ndarray, "texels 3"]
    visibility: Float[ndarray, " texels"]
    curvature: Float[ndarray, " texels"]
    axles: tuple[float, ...]
    texel: float

    def moved(self, offset: Float[ndarray, "texels 3"]) -> Site:
        """The same surroundings with every texel a little elsewhere, in the units of `position`."""
        return replace(self, position=self.position + offset)

    def at(self, texels: Int[ndarray, " chosen"]) -> Site:
        """The same site at some of its texels only: recipes paint each texel by itself."""
        names = ("position", "height", "normal", "visibility", "curvature")
        return replace(self, **{name: getattr(self, name)[texels] for name in names})
