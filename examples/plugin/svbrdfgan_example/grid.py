"""Which triangle a ray meets first: a uniform grid of cells, each with the triangles that may lie in it."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True, eq=False)
class Grid:
    """Triangles in cells.

    Attributes:
        corners: of each triangle (faces, 3, 3).
        low, size: corner of the box, and edges of one cell (3,).
        shape: cells along each axis (3,).
        first: where each cell's triangles begin in `items` (cells + 1,).
        items: faces, cell by cell.
        reach: the box's diagonal.
    """

    corners: Tensor
    low: Tensor
    size: Tensor
    shape: Tensor
    first: Tensor
    items: Tensor
    reach: float

    @classmethod
    def of_triangles(cls, corners: Tensor, density: float) -> Grid:
        """A grid of about `density` cells for each triangle."""
        low, high = corners.amin((0, 1)), corners.amax((0, 1))
        reach = float((high - low).norm())
        low, high = low - 1e-6 * reach, high + 1e-6 * reach
        extent = (high - low).clamp(min=1e-2 * reach)
        edge = (extent.prod() / (density * len(corners))) ** (1 / 3)
        shape = (extent / edge).ceil().long().clamp(1, 256)
        size = (high - low) / shape
        start, end = (((c - low) / size).long().clamp(min=0) for c in (corners.amin(1), corners.amax(1)))
        start, end = torch.minimum(start, shape - 1), torch.minimum(end, shape - 1)
        span = end - start + 1
        face, step = spread(span.prod(dim=1))
        nx, ny, _ = span[face].unbind(1)
        cell = start[face] + torch.stack([step % nx, step // nx % ny, step // (nx * ny)], dim=1)
        index = flat(cell, shape)
        order = torch.argsort(index, stable=True)
        count = torch.bincount(index, minlength=int(shape.prod()))
        first = torch.cat([torch.zeros(1, dtype=torch.long), count.cumsum(0)])
        return cls(corners, low, size, shape, first, face[order], reach)

    def nearest(self, origin: Tensor, ray: Tensor) -> Tensor:
        """The triangle that each ray meets first, or -1. Rays leave their origins' surfaces: nothing is met at once."""
        least = 1e-9 * self.reach
        inverse = 1.0 / torch.where(ray == 0.0, 1e-30, ray)
        near, far = (self.low - origin) * inverse, (self.low + self.size * self.shape - origin) * inverse
        enter = torch.minimum(near, far).amax(1).clamp(min=0.0)
        leave = torch.maximum(near, far).amin(1)
        best, face = torch.full_like(enter, torch.inf), torch.full(enter.shape, -1)
        alive = torch.nonzero(enter <= leave)[:, 0]
        cell = ((origin + enter[:, None] * ray - self.low) / self.size).long().clamp(min=0)
        cell = torch.minimum(cell, self.shape - 1)
        forward = (ray > 0.0).long()
        while len(alive):
            here = flat(cell[alive], self.shape)
            which, step = spread(self.first[here + 1] - self.first[here])
            item, who = self.items[self.first[here][which] + step], alive[which]
            t, *_ = meet(self.corners[item], origin[who], ray[who])
            t = torch.where(t > least, t, torch.inf)
            best.scatter_reduce_(0, who, t, "amin")
            won = (t == best[who]) & (t < torch.inf)
            face[who[won]] = -1
            face.scatter_reduce_(0, who[won], item[won], "amax")  # of equally near ones always the same
            walls = (self.low + self.size * (cell[alive] + forward[alive]) - origin[alive]) * inverse[alive]
            wall, axis = walls.min(dim=1)
            cell[alive, axis] += 2 * forward[alive, axis] - 1
            within = (cell[alive, axis] >= 0) & (cell[alive, axis] < self.shape[axis])
            alive = alive[within & (best[alive] > wall)]
        return face


def meet(corners: Tensor, origin: Tensor, ray: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Distance along each ray to its triangle, infinite if missed, and barycentric v, w (Moeller and Trumbore 1997)."""
    a, b, c = corners.unbind(1)
    s, p = origin - a, torch.linalg.cross(ray, c - a)
    q, determinant = torch.linalg.cross(s, b - a), (p * (b - a)).sum(1)
    v, w, t = (dot.sum(1) / determinant for dot in (p * s, q * ray, q * (c - a)))
    inside = (v >= -1e-12) & (w >= -1e-12) & (v + w <= 1.0 + 1e-12) & torch.isfinite(t)
    return torch.where(inside, t, torch.inf), v, w


def spread(count: Tensor) -> tuple[Tensor, Tensor]:
    """0, 0, 1, 1, 1 and 0, 1, 0, 1, 2 for counts of 2 and 3."""
    which = torch.repeat_interleave(torch.arange(len(count)), count)
    return which, torch.arange(len(which)) - (count.cumsum(0) - count)[which]


def flat(cell: Tensor, shape: Tensor) -> Tensor:
    """A cell's place in a list of all."""
    return (cell[:, 2] * shape[1] + cell[:, 1]) * shape[0] + cell[:, 0]
