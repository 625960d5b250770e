"""What orientation is found from: points all over a mesh's surface, its wheels, and what its names say."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from svbrdfgan.asset.round_pieces import Wheels, find_wheels
from svbrdfgan.asset.words import named_parts
from svbrdfgan.io.rows import merge_rows
from svbrdfgan.types import Mesh, Part

POINTS = 20_000
_SEED = 1
_SEE_THROUGH = 0.9
"""Parts whose alpha is below this are glass, whatever their name."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """A mesh in the box from -0.5 to 0.5 along its longest side, centred at 0.

    Attributes:
        points: spread uniformly over the surface.
        normals: of the faces that they lie on, of unit length; outside and inside may be confused.
        sides: lengths of the bounding box.
        said: for "glass", "wheel", "front" and "rear", whether a point's part is named so.
    """

    points: Float[ndarray, "points 3"]
    normals: Float[ndarray, "points 3"]
    sides: Float[ndarray, " axes"]
    wheels: Wheels
    said: Mapping[str, Bool[ndarray, " points"]] = field(default_factory=dict)

    def turned(self, matrix: Float[ndarray, "3 3"]) -> Evidence:
        """The same in other axes. The matrix only permutes axes and changes signs."""
        sides = np.abs(matrix) @ self.sides
        return Evidence(self.points @ matrix.T, self.normals @ matrix.T, sides, self.wheels.turned(matrix), self.said)

    @cached_property
    def relative(self) -> Float[ndarray, "points 3"]:
        """The points in a box of sides 1, centred at 0."""
        return self.points / np.maximum(self.sides, 1e-9)


def gather(mesh: Mesh, names: Sequence[str] | None) -> Evidence:
    """The evidence of a mesh. `names` are further names of its parts."""
    low, high = mesh.bounds
    positions, welded = merge_rows(np.round((mesh.positions - 0.5 * (low + high)) / np.max(high - low), 6))
    faces = welded[mesh.faces]
    points, normals, part = _spread(positions[faces], mesh.face_part)
    said = named_parts([f"{part.name} {name}" for part, name in _named(mesh, names)])
    said["glass"] = said["glass"] | np.array([_see_through(part) for part in mesh.parts])
    sides = (high - low) / np.max(high - low)
    wheels = find_wheels(positions, faces, mesh.face_part)
    return Evidence(points, normals, sides, wheels, {what: parts[part] for what, parts in said.items()})


def _named(mesh: Mesh, names: Sequence[str] | None) -> zip[tuple[Part, str]]:
    return zip(mesh.parts, [""] * len(mesh.parts) if names is None else names, strict=True)


def _see_through(part: Part) -> bool:
    """Whether the part is blended, and lets light through all over."""
    alpha = part.file_maps.get("alpha")
    return alpha is not None and alpha.cutoff is None and alpha.factor[0] < _SEE_THROUGH


def _spread(
    corners: Float[ndarray, "faces 3 3"], face_part: Int[ndarray, " faces"]
) -> tuple[Float[ndarray, "points 3"], Float[ndarray, "points 3"], Int[ndarray, " points"]]:
    """Random points, their faces' normals and parts: equal numbers on equal areas, the same on every call."""
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(cross, axis=1)
    random = np.random.default_rng(_SEED)
    up_to = np.cumsum(areas)
    ranks = (np.arange(POINTS) + random.random(POINTS)) / POINTS * up_to[-1]
    face = np.minimum(np.searchsorted(up_to, ranks, side="right"), len(corners) - 1)
    along = np.sqrt(random.random(POINTS))
    across = random.random(POINTS)
    weights = np.stack([1.0 - along, along * (1.0 - across), along * across], axis=1)
    points = np.einsum("pc,pcx->px", weights, corners[face])
    return points, cross[face] / np.maximum(areas[face], 1e-30)[:, None], face_part[face]
