"""The BSDF at points of the surface, where each map is looked up, then understood; and gradients back to the maps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan_numpy.bsdf import Bsdf, BsdfGradient
from svbrdfgan_numpy.normal_map import Frame
from svbrdfgan_numpy.surface import Points, PreparedSurface, frames_at
from svbrdfgan_numpy.textures import Lookup, Taps, Texture

MAPS = ("base_color", "roughness", "metallic", "normal")


@dataclass(frozen=True, eq=False)
class MaterialPoints:
    """Points, with all of their materials but the values of maps.

    Attributes:
        points: where rays meet the surface.
        lookups: of each of `MAPS`.
        frame: the tangent frames of those that have a normal map.
    """

    points: Points
    lookups: Mapping[str, Lookup]
    frame: Frame

    @classmethod
    def of(cls, prepared: PreparedSurface, points: Points, maps: Mapping[str, Texture]) -> MaterialPoints:
        """The points with these maps, of which only the shapes count."""
        lookups = {name: maps[name].lookup(points.part, points.uv) for name in MAPS}
        return cls(points, lookups, frames_at(prepared, points, lookups["normal"].points))

    def bsdf(self, maps: Mapping[str, Texture]) -> Bsdf:
        """The material at the points, with these maps."""
        looked_up = {name: lookup.taps.apply(maps[name].texels) for name, lookup in self.lookups.items()}
        roughness, metallic = np.ones(len(self.points.part)), np.zeros(len(self.points.part))
        normal = self.points.normal.copy()
        roughness[self.lookups["roughness"].points] = looked_up["roughness"][:, 0]
        metallic[self.lookups["metallic"].points] = looked_up["metallic"][:, 0]
        glossy, mapped = self.lookups["roughness"].points, self.lookups["normal"].points
        normal[mapped] = self.frame.tilted(looked_up["normal"])
        return Bsdf(glossy, looked_up["base_color"], roughness, metallic, normal, mapped)

    def bsdf_vjp(
        self, maps: Mapping[str, Texture], grad: BsdfGradient
    ) -> Iterator[tuple[str, Taps, Float[ndarray, "_ channels"]]]:
        """Yields for each map its name, its taps and the gradient of what they gave, from that of `bsdf`."""
        values = {
            "base_color": grad.base_color,
            "roughness": grad.roughness[:, None],
            "metallic": grad.metallic[:, None],
            "normal": grad.normal,
        }
        for name, lookup in self.lookups.items():
            of_lookup = values[name][lookup.points]
            if name == "normal":
                of_lookup = self.frame.tilted_vjp(lookup.taps.apply(maps["normal"].texels), of_lookup)
            yield name, lookup.taps, of_lookup
