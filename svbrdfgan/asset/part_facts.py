"""What is known of the parts of an asset: place, shape, looks over the UVs that they use, and how open they lie."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from svbrdfgan.asset.asset import Asset
from svbrdfgan.asset.part_looks import Looks, PartLooks
from svbrdfgan.asset.wheels import find_wheels
from svbrdfgan.geometry.normals import face_areas, face_normals
from svbrdfgan.geometry.sampling import faces_by_area, points_in_triangle
from svbrdfgan.io.rows import members
from svbrdfgan.types import Part, Surface
from svbrdfgan.weathering.occlusion import ambient_visibility

Orientation = Float[ndarray, "3 3"]

_SAMPLES = 256
"""Points on each part at which textures and visibility are looked up."""
_ALL_SAMPLES = 400_000
"""The most on all parts together."""
_FLAT = 0.02  # height of a flat part, of the height of the whole


@dataclass(frozen=True, eq=False)
class Facts:
    """What is known of a part: all pieces of one material and of the same names.

    Attributes:
        pieces: indices into the asset's pieces.
        names: of the material, the mesh and the node, in this order; unnamed ones are left out.
        above: of the nodes above, nearest first, but for those that stand above every piece.
        area: share of the asset's area.
        share: share of its area without the ground.
        low, high: corners of the bounding box, where 0 and 1 are the corners of the vehicle's box. Y is up.
        looks: colour, gloss, alpha and emission.
        wheel, tread: shares of its area that belong to wheels, and to their outermost shells.
        open: mean ambient visibility, on the more open side of each point.
        ground: whether it is a flat sheet under all else.
    """

    pieces: tuple[int, ...]
    names: tuple[str, ...]
    above: tuple[str, ...]
    area: float
    share: float
    low: Float[ndarray, " 3"]
    high: Float[ndarray, " 3"]
    looks: Looks
    wheel: float
    tread: float
    open: float
    ground: bool


def part_facts(asset: Asset, orientation: Orientation | None = None) -> tuple[Facts, ...]:
    """The facts of each part, in the order of its first piece. Pieces without faces are left out.

    Args:
        orientation: turns the file's axes to Y up and the nose at +Z; None if the file has them so.
    """
    mesh, groups, shared = asset.mesh, _groups(asset), _shared_names(asset)
    place_of = {key: number for number, key in enumerate(groups)}
    positions = mesh.positions if orientation is None else mesh.positions @ orientation.T
    corners, area = positions[mesh.faces], face_areas(positions, mesh.faces)
    part = np.array([place_of[_key(asset, piece)] for piece in range(len(asset.pieces))])[asset.face_piece]
    members_of = members(part, len(groups))
    used = [number for number, mine in enumerate(members_of) if len(mine)]
    ground = np.zeros(len(groups), bool)
    ground[_ground(corners, members_of, used)] = True
    standing = ~ground[part]
    box = _box(corners[standing])
    low, size = box[0], np.maximum(box[1] - box[0], 1e-12)
    wheels = find_wheels(positions, mesh.faces, np.where(standing, asset.face_piece, -1), low[1], size[1])
    points = max(1, min(_SAMPLES, _ALL_SAMPLES // len(used)))
    samples = {number: _samples(area, members_of[number], points) for number in used}
    opened = _openness(positions, mesh.faces, samples)
    looks, total = PartLooks(asset), max(float(area.sum()), 1e-300)
    without_ground = max(float(area[standing].sum()), 1e-300)
    found = []
    for number in used:
        mine = members_of[number]
        pieces = tuple(np.unique(asset.face_piece[mine]).tolist())
        own, place = max(float(area[mine].sum()), 1e-300), (_box(corners[mine]) - low) / size
        facts = Facts(
            pieces,
            groups[number][1],
            _above(asset, pieces[0], shared),
            own / total,
            own / without_ground,
            place[0],
            place[1],
            looks.of(pieces[0], *samples[number]),
            float(area[mine[wheels.inside[mine]]].sum()) / own,
            float(area[mine[wheels.tread[mine]]].sum()) / own,
            opened[number],
            bool(ground[number]),
        )
        found.append(facts)
    return tuple(found)


def piece_names(asset: Asset, piece: int) -> tuple[str, ...]:
    """The names of a piece's material, mesh and node, in this order; unnamed ones and repetitions are left out."""
    material, mesh = asset.material(piece) or {}, asset.document.table("meshes")[asset.source(piece).mesh]
    node = asset.document.table("nodes")[asset.source(piece).node]
    names = (entry.get("name") for entry in (material, mesh, node))
    found = tuple(dict.fromkeys(name for name in names if isinstance(name, str) and name))
    return found or (asset.pieces[piece].part.name,)


_Key = tuple[int | None, tuple[str, ...]]


def _key(asset: Asset, piece: int) -> _Key:
    return asset.primitive(piece).get("material"), piece_names(asset, piece)


def _groups(asset: Asset) -> list[_Key]:
    return list(dict.fromkeys(_key(asset, piece) for piece in range(len(asset.pieces))))


def _shared_names(asset: Asset) -> set[str]:
    """Names of nodes that stand above all pieces."""
    return set.intersection(*(set(asset.node_names(index)) for index in range(len(asset.pieces))))


def _above(asset: Asset, piece: int, shared: set[str]) -> tuple[str, ...]:
    """Names of the nodes above a piece, nearest first, without those that stand above all pieces."""
    own = set(piece_names(asset, piece))
    return tuple(name for name in reversed(asset.node_names(piece)) if name not in shared | own)


def _box(corners: Float[ndarray, "faces 3 3"]) -> Float[ndarray, "2 3"]:
    return np.stack([corners.min(axis=(0, 1)), corners.max(axis=(0, 1))])


def _ground(
    corners: Float[ndarray, "faces 3 3"], members_of: Sequence[Int[ndarray, " faces"]], used: list[int]
) -> list[int]:
    """The parts that are flat sheets under all others, at least about as large as these."""
    boxes = np.array([_box(corners[members_of[number]]) for number in used])
    found = []
    if len(used) < 2:
        return []
    lows, highs = _least_others(boxes[:, 0]), -_least_others(-boxes[:, 1])
    for number, mine, low, high in zip(used, boxes, lows, highs, strict=True):
        height = max(float(high[1] - low[1]), 1e-12)
        flat = mine[1, 1] - mine[0, 1] < _FLAT * height and mine[1, 1] < low[1] + 2.0 * _FLAT * height
        beyond = (mine[0] < low + 0.1 * (high - low)) & (mine[1] > high - 0.1 * (high - low))
        if flat and beyond[0] and beyond[2]:
            found.append(number)
    return found


def _least_others(values: Float[ndarray, "parts 3"]) -> Float[ndarray, "parts 3"]:
    """For each part, the least value of all others, along each axis."""
    least, next_ = np.sort(values, axis=0)[:2]
    return np.where(values == least, next_, least)


def _samples(
    area: Float[ndarray, " faces"], mine: Int[ndarray, " mine"], count: int
) -> tuple[Int[ndarray, " points"], Float[ndarray, "points 3"]]:
    """Faces of a part and barycentric coordinates in them, evenly spread over its area."""
    total = np.cumsum(np.maximum(area[mine], 1e-300))
    owner = faces_by_area(total, count)
    return mine[owner], points_in_triangle(np.arange(count))


def _openness(
    positions: Float[ndarray, "vertices 3"],
    faces: Int[ndarray, "faces 3"],
    samples: Mapping[int, tuple[Int[ndarray, " points"], Float[ndarray, "points 3"]]],
) -> dict[int, float]:
    normals = face_normals(positions, faces)
    flat = np.arange(3 * len(faces)).reshape(-1, 3)
    shape = _unwelded(positions[faces].reshape(-1, 3), np.repeat(normals, 3, axis=0), flat)
    face = np.concatenate([face for face, _ in samples.values()])
    weight = np.concatenate([weight for _, weight in samples.values()])
    points, facing = np.einsum("pk,pki->pi", weight, positions[faces[face]]), normals[face]
    both = ambient_visibility(shape, np.r_[points, points], np.r_[facing, -facing]).reshape(2, len(samples), -1)
    return dict(zip(samples, both.max(axis=0).mean(axis=1).tolist(), strict=True))


def _unwelded(
    positions: Float[ndarray, "corners 3"], normals: Float[ndarray, "corners 3"], faces: Int[ndarray, "faces 3"]
) -> Surface:
    """A surface whose UVs mean nothing."""
    zeros: Bool[ndarray, " faces"] = np.zeros(len(faces), np.int64)
    weights, uv = np.tile(np.eye(3), (len(faces), 1, 1)), np.zeros((len(positions), 2))
    elevation = np.zeros(len(positions))
    return Surface(positions, normals, uv, faces, zeros, (Part("all"),), elevation, np.arange(len(faces)), weights)
