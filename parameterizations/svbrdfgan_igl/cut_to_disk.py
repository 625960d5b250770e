"""Cuts a mesh that is one manifold surface open to a disk, so that it can be flattened without a wrap."""

from __future__ import annotations

import igl
import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from svbrdfgan.geometry.normals import face_areas
from svbrdfgan_igl.energy import squared_stretch, stretch
from svbrdfgan_igl.flatten import least_stretch
from svbrdfgan_igl.seams import SurfaceGraph, branch, cut_open, opening
from svbrdfgan_igl.topology import Disk, compact, components, is_manifold
from svbrdfgan_igl.tutte import MILD, mildness, tutte

ENOUGH = 1.15
"""L2 stretch at or below which no further seams are added."""
MOST_SEAMS = 10
_PROXY_FACES = 2500  # of the coarse copy on which seams are chosen
_PROXY_ROUNDS = 12
_LEAST_AREA = 1e-14  # of the square of the mesh's size


def is_one_surface(positions: Float[ndarray, "vertices 3"], faces: Int[ndarray, "faces 3"]) -> bool:
    """Whether the mesh is one manifold surface, consistently wound, without degenerate faces."""
    area = face_areas(positions, faces)
    size = np.ptp(positions[np.unique(faces)], axis=0).max()
    return bool((area > _LEAST_AREA * size**2).all()) and is_manifold(faces) and components(faces)[0] == 1


def cut_to_disk(
    positions: Float[ndarray, "vertices 3"], faces: Int[ndarray, "faces 3"], seams: int | None
) -> tuple[Disk, Int[ndarray, " vertices"]]:
    """The surface as a disk, and for each of its vertices the vertex of the mesh that it copies.

    Args:
        seams: number of seams besides those that the topology needs; None adds seams to a surface that is no disk while
            its L2 stretch is above `ENOUGH`.

    Raises:
        EmbeddingError: the surface cannot be cut to a disk.
    """
    net = SurfaceGraph.of(positions, faces)
    cut = opening(net)
    for place in _worst_places(positions, faces, seams):
        # rounded, so that the choice among equals does not depend on the last bits of the coordinates
        vertex = int(np.argmin(np.round(((positions - place) ** 2).sum(axis=1), 12)))
        cut = branch(net, cut, vertex)
    return cut_open(net, cut)


def _worst_places(
    positions: Float[ndarray, "vertices 3"], faces: Int[ndarray, "faces 3"], seams: int | None
) -> list[Float[ndarray, " 3"]]:
    """The ends of further seams: each is the place of greatest stretch on a coarse copy with the seams before it."""
    net = _coarse(positions, faces)
    cut = opening(net)
    if seams is None and not len(cut):
        return []
    places: list[Float[ndarray, " 3"]] = []
    while len(places) < (MOST_SEAMS if seams is None else seams):
        disk, source = cut_open(net, cut)
        # the descent may fail to start from a map that is not mild
        uv = least_stretch(disk, "free", 0.0, _PROXY_ROUNDS) if mildness(disk) > MILD else tutte(disk)
        if seams is None and stretch(disk.positions, disk.faces, uv) <= ENOUGH:
            break
        vertex = int(source[_worst_vertex(disk, uv)])
        places.append(net.positions[vertex])
        cut = branch(net, cut, vertex)
    return places


def _worst_vertex(disk: Disk, uv: Float[ndarray, "vertices 2"]) -> int:
    """The vertex with the greatest mean log stretch, not on the border and, if possible, not next to it."""
    cost = np.log(squared_stretch(disk.positions, disk.faces, uv))
    total = np.bincount(disk.faces.ravel(), np.repeat(cost, 3), len(uv))
    mean = np.round(total / np.bincount(disk.faces.ravel(), minlength=len(uv)), 9)
    near = np.zeros(len(uv), dtype=bool)
    near[disk.border] = True
    beside = np.zeros(len(uv), dtype=bool)
    beside[disk.faces[near[disk.faces].any(axis=1)]] = True
    free = ~beside if (~beside).any() else ~near
    return int(np.argmax(np.where(free, mean, -np.inf)))


def _coarse(positions: Float[ndarray, "vertices 3"], faces: Int[ndarray, "faces 3"]) -> SurfaceGraph:
    """A simplified surface with the same topology; the surface itself if it is small or cannot be simplified."""
    if len(faces) > _PROXY_FACES:
        found = igl.decimate(positions, faces, _PROXY_FACES)
        simple = compact(found[0], np.asarray(found[1], dtype=np.int64))
        if is_one_surface(simple.positions, simple.faces):
            return SurfaceGraph.of(simple.positions, simple.faces)
    used = compact(positions, faces)
    return SurfaceGraph.of(used.positions, used.faces)
