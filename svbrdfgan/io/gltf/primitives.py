"""Triangles and vertex attributes of a glTF document's primitives, posed as the file shows them before it moves."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from svbrdfgan.errors import AssetError
from svbrdfgan.io.gltf.accessors import Matrix, read_accessor, read_floats
from svbrdfgan.io.gltf.document import Document, Json

POINTS_OR_LINES = (0, 1, 2, 3)
_TRIANGLES, _STRIP, _FAN = 4, 5, 6


def is_solid(primitive: Json) -> bool:
    """Whether a primitive has faces: it is neither points nor lines, and has positions."""
    return primitive.get("mode", _TRIANGLES) not in POINTS_OR_LINES and "POSITION" in primitive.get("attributes", {})


def count_triangles(document: Document, primitive: Json) -> int:
    """What the file says of the number of triangles, or a third of that of vertices if these are more."""
    accessors, vertices = document.table("accessors"), primitive["attributes"]["POSITION"]
    count = int(accessors[primitive.get("indices", vertices)]["count"])
    found = count // 3 if primitive.get("mode", _TRIANGLES) == _TRIANGLES else max(count - 2, 0)
    return max(found, int(accessors[vertices]["count"]) // 3)


def triangles(document: Document, primitive: Json) -> Int[ndarray, "faces 3"]:
    """The vertices of each triangle, whose winding is the file's; strips and fans become single triangles.

    Raises:
        AssetError: an index names a vertex that does not exist.
    """
    count = document.table("accessors")[primitive["attributes"]["POSITION"]]["count"]
    index = np.arange(count)
    if "indices" in primitive:
        index = read_accessor(document, primitive["indices"])[:, 0].astype(np.int64)
    if len(index) and index.max() >= count:
        raise AssetError(f"{document.path} has faces that name vertices outside 0..{count - 1}; is it whole?")
    mode = primitive.get("mode", _TRIANGLES)
    if mode == _TRIANGLES:
        return index[: len(index) // 3 * 3].reshape(-1, 3)
    first = np.arange(max(len(index) - 2, 0))
    if mode == _FAN:
        return np.stack([index[first + 1], index[first + 2], np.full(len(first), index[0])], axis=1)
    odd = first % 2  # each second triangle of a strip runs the other way
    return np.stack([index[first], index[first + 1 + odd], index[first + 2 - odd]], axis=1)


def morphed_positions(document: Document, primitive: Json, mesh: Json) -> Float[ndarray, "vertices 3"]:
    """Positions under the mesh's default morph weights, in its coordinates."""
    positions = read_floats(document, primitive["attributes"]["POSITION"])
    for weight, target in zip(mesh.get("weights", ()), primitive.get("targets", ()), strict=False):
        if weight and "POSITION" in target:
            positions = positions + weight * read_floats(document, target["POSITION"])
    return positions


def skinned_positions(
    document: Document, primitive: Json, positions: Float[ndarray, "vertices 3"], skin: list[Matrix]
) -> Float[ndarray, "vertices 3"]:
    """Positions in the world; as they are if the primitive names no joints.

    Args:
        skin: for each joint, the matrix that takes the mesh's coordinates to the world.

    Raises:
        AssetError: a vertex names a joint that does not exist.
    """
    if "JOINTS_0" not in primitive["attributes"]:
        return positions
    joints = read_accessor(document, primitive["attributes"]["JOINTS_0"]).astype(np.int64)
    weights = read_floats(document, primitive["attributes"]["WEIGHTS_0"])
    if joints.size and joints.max() >= len(skin):
        raise AssetError(f"{document.path} has vertices that name joint {joints.max()} of {len(skin)}; is it whole?")
    weights = weights / np.maximum(weights.sum(axis=1, keepdims=True), 1e-30)
    matrices = np.einsum("vj,vjab->vab", weights, np.stack(skin)[joints])
    return np.einsum("vab,vb->va", matrices[:, :3, :3], positions) + matrices[:, :3, 3]


def skin_matrices(document: Document, skin: Json, world: dict[int, Matrix]) -> list[Matrix]:
    """For each joint of a skin, the matrix from the mesh's coordinates to the world in the pose of the nodes."""
    joints = skin["joints"]
    back = [np.eye(4)] * len(joints)
    if "inverseBindMatrices" in skin:
        stored = read_floats(document, skin["inverseBindMatrices"]).reshape(-1, 4, 4)
        back = list(stored.transpose(0, 2, 1))
    return [world.get(joint, np.eye(4)) @ own for joint, own in zip(joints, back, strict=False)]


def texture_coordinates(document: Document, primitive: Json, number: int) -> Float[ndarray, "vertices 2"] | None:
    """TEXCOORD_n with the origin at the lower left; None if the primitive lacks it.

    Raises:
        AssetError: it is not of the primitive's vertices.
    """
    if f"TEXCOORD_{number}" not in primitive["attributes"]:
        return None
    return vertex_floats(document, primitive, f"TEXCOORD_{number}")[:, :2] * (1.0, -1.0) + (0.0, 1.0)


def vertex_floats(document: Document, primitive: Json, name: str) -> Float[ndarray, "vertices components"]:
    """An attribute of a primitive's vertices, as `read_floats` reads it.

    Raises:
        AssetError: it is of more or fewer vertices than the primitive has.
    """
    values, accessors = read_floats(document, primitive["attributes"][name]), document.table("accessors")
    if len(values) != (count := accessors[primitive["attributes"]["POSITION"]]["count"]):
        raise AssetError(f"{document.path} has a {name} of {len(values)} vertices, of {count}; is it whole?")
    return values


def vertex_colors(document: Document, primitive: Json) -> Float[ndarray, "vertices channels"]:
    """COLOR_0 of a primitive: linear RGB or RGBA in [0, 1]. What is not a number becomes 1, which tints nothing.

    Raises:
        AssetError: it is of more or fewer vertices than the primitive has.
    """
    return np.clip(np.nan_to_num(vertex_floats(document, primitive, "COLOR_0"), nan=1.0), 0.0, 1.0)
