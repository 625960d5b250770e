"""The nodes of a glTF document: where each mesh stands in the world, once for each time that it is shown."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan.errors import AssetError
from svbrdfgan.io.gltf.accessors import Matrix, read_floats
from svbrdfgan.io.gltf.document import Document, Json

_POSE = {"matrix", "translation", "rotation", "scale"}

Vector = Sequence[float] | Float[ndarray, " axes"]

INSTANCING = "EXT_mesh_gpu_instancing"
MAX_PLACEMENTS = 100_000
"""Nodes visited, GPU instances included. A small file can claim more by naming one node many times."""
MAX_DEPTH = 1000
"""Nodes above one another."""


@dataclass(frozen=True, eq=False)
class Placement:
    """A mesh as one node shows it.

    Attributes:
        node, mesh: indices into the header's tables.
        instance: 0, or the number of a GPU instance of that node.
        matrix: from the mesh's coordinates to the world's.
    """

    node: int
    mesh: int
    instance: int
    matrix: Matrix


def placements(document: Document) -> list[Placement]:
    """All meshes of the scene that is shown, node after node; of a file without scenes, those of all root nodes.

    Raises:
        AssetError: nodes form a loop or lie too deep, or there are more of them than `MAX_PLACEMENTS`.
    """
    found: list[Placement] = []
    for node, world in world_matrices(document):
        entry = document.table("nodes")[node]
        if "mesh" in entry:
            instances = _gpu_instances(document, entry)
            if len(found) + len(instances) > MAX_PLACEMENTS:
                raise AssetError(f"{document.path} shows more than {MAX_PLACEMENTS} meshes; is it whole?")
            found += [Placement(node, entry["mesh"], k, world @ own) for k, own in enumerate(instances)]
    return found


def world_matrices(document: Document) -> Iterator[tuple[int, Matrix]]:
    """Each node of the scene that is shown, and the matrix from its coordinates to the world's; parents come first."""
    nodes = document.table("nodes")
    visited = 0
    pending: list[tuple[int, Matrix, tuple[int, ...]]] = [
        (root, np.eye(4), (root,)) for root in reversed(_roots(document))
    ]
    while pending:
        node, parent, above = pending.pop()
        world = parent @ local_matrix(nodes[node]) if _POSE & nodes[node].keys() else parent
        visited += 1
        if visited > MAX_PLACEMENTS:
            raise AssetError(f"{document.path} shows more than {MAX_PLACEMENTS} nodes; is it whole?")
        if len(above) > MAX_DEPTH:
            raise AssetError(f"{document.path} has more than {MAX_DEPTH} nodes above one another; is it whole?")
        yield node, world
        for child in reversed(_each_once(nodes[node].get("children", []))):
            if child in above:
                raise AssetError(f"{document.path} has nodes that contain themselves; is it whole?")
            pending.append((child, world, (*above, child)))


def local_matrix(node: Json) -> Matrix:
    """The transform that a node states, as a matrix or as translation, rotation (x, y, z, w) and scale."""
    if "matrix" in node:
        return np.asarray(node["matrix"], np.float64).reshape(4, 4).T
    translation, rotation = node.get("translation", (0, 0, 0)), node.get("rotation", (0, 0, 0, 1))
    return transform(translation, rotation, node.get("scale", (1, 1, 1)))


def transform(translation: Vector, rotation: Vector, scale: Vector) -> Matrix:
    """The matrix that scales, then turns by a quaternion (x, y, z, w), then moves."""
    x, y, z, w = np.asarray(rotation, np.float64) / max(float(np.linalg.norm(rotation)), 1e-30)
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = turn * np.asarray(scale, np.float64), translation
    return matrix


def _roots(document: Document) -> list[int]:
    scenes = document.table("scenes")
    if scenes:
        return _each_once(scenes[document.header.get("scene", 0)].get("nodes", []))
    nodes = document.table("nodes")
    children = {child for node in nodes for child in node.get("children", [])}
    return [index for index in range(len(nodes)) if index not in children]


def _each_once(nodes: Sequence[int]) -> list[int]:
    """The nodes of one list, in which glTF allows none twice: it would stand where it stands already."""
    return list(dict.fromkeys(nodes))


def _gpu_instances(document: Document, node: Json) -> list[Matrix]:
    attributes = node.get("extensions", {}).get(INSTANCING, {}).get("attributes", {})
    stored = {name: read_floats(document, index) for name, index in attributes.items() if not name.startswith("_")}
    if not stored:
        return [np.eye(4)]
    count = len(next(iter(stored.values())))
    if count > MAX_PLACEMENTS:
        raise AssetError(f"{document.path} shows more than {MAX_PLACEMENTS} meshes; is it whole?")
    moves = stored.get("TRANSLATION", np.zeros((count, 3)))
    turns = stored.get("ROTATION", np.tile([0.0, 0.0, 0.0, 1.0], (count, 1)))
    sizes = stored.get("SCALE", np.ones((count, 3)))
    return [transform(move, turn, size) for move, turn, size in zip(moves, turns, sizes, strict=True)]
