"""Meshes as read from files, and surfaces as embeddings return them. NumPy, float64 and int64."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from svbrdfgan.errors import AssetError

FILE_CHANNELS = {"roughness": 1, "metallic": 1, "normal": 3, "alpha": 1}
"""The maps that files give besides base colour, and their channels."""


@dataclass(frozen=True)
class FileMap:
    """A map of a part's material as its file has it: `factor`, times the lookup in `texture` over the mesh's own UVs.

    Attributes:
        factor: one number for each channel. Of `normal`: the scale of x, the scale of y, and 1.
        texture: (rows, cols, channels), row 0 at v = 0; None if the map is the factor alone.
        cutoff: of `alpha` alone: a product below it counts as 0 and any other as 1. None if alpha is blended.
        uv_set: where the texture is looked up, as for `Mesh.uv_set`.
    """

    factor: tuple[float, ...]
    texture: Float[ndarray, "rows cols channels"] | None = None
    cutoff: float | None = None
    uv_set: int = 0


@dataclass(frozen=True)
class Part:
    """A group of faces that share one material.

    A mesh's part has what its file says, over the mesh's own UVs: `base_color`, `texture` and `file_maps`. Renderers
    read none of these. They get materials, and `alpha`, over the UV of the surface that the mesh was embedded in.

    Attributes:
        name: the material's name in the file, unique within its mesh.
        base_color: linear RGB reflectance in [0, 1]; multiplies `texture` where there is one.
        texture: linear RGB reflectance (rows, cols, 3) over the mesh's own UVs, row 0 at v = 0; None if constant.
        hidden_half_of: name of the part whose faces these are that lie below others at the same UV; they keep its base
            material and get no layer. None for a part of the mesh.
        alpha: probability in [0, 1] that a ray which meets the part does not pass through it: a constant, or a texture
            (rows, cols) over the surface's UV, row 0 at v = 0. A mesh's part leaves it at 1; its file's is in
            `file_maps`.
        file_maps: by name, what the file says of `roughness`, `metallic`, `normal` and `alpha`. Without `roughness`
            the part is Lambertian. Without `alpha` it is opaque.
        texture_uv_set: where `texture` is looked up, as for `Mesh.uv_set`.

    Raises:
        AssetError: `alpha` is out of range or not a texture, or a file's map has an unknown name or other channels.
    """

    name: str
    base_color: tuple[float, float, float] = (0.8, 0.8, 0.8)
    texture: Float[ndarray, "rows cols 3"] | None = None
    hidden_half_of: str | None = None
    alpha: float | Float[ndarray, "rows cols"] = 1.0
    file_maps: Mapping[str, FileMap] = field(default_factory=dict)
    texture_uv_set: int = 0

    def __post_init__(self) -> None:
        alpha = np.asarray(self.alpha)
        if alpha.ndim not in (0, 2) or alpha.size == 0 or not ((alpha >= 0.0) & (alpha <= 1.0)).all():
            raise AssetError(f"part {self.name!r} has an alpha that is not a number in [0, 1] or a texture of such.")
        for name, given in self.file_maps.items():
            channels = FILE_CHANNELS.get(name)
            shape = (channels,) if given.texture is None else given.texture.shape[2:]
            if channels is None or len(given.factor) != channels or shape != (channels,):
                raise AssetError(
                    f"part {self.name!r} has a map {name!r} of {len(given.factor)} channels; wanted one of "
                    f"{', '.join(f'{known} ({size})' for known, size in FILE_CHANNELS.items())}."
                )

    @property
    def hidden(self) -> bool:
        """Whether the part is the hidden half of another."""
        return self.hidden_half_of is not None

    @property
    def mesh_part(self) -> str:
        """Name of the mesh's part: the part itself, or the one whose hidden half it is."""
        return self.name if self.hidden_half_of is None else self.hidden_half_of

    @property
    def opaque(self) -> bool:
        """Whether no ray passes through the part."""
        return bool(np.all(np.asarray(self.alpha) == 1.0))

    @property
    def all_maps(self) -> dict[str, FileMap]:
        """All that the file says: `base_color` and `file_maps`."""
        return {"base_color": FileMap(self.base_color, self.texture, uv_set=self.texture_uv_set), **self.file_maps}


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles in metres, right-handed, Y up, with welded vertices. They need be neither closed nor manifold.

    Attributes:
        positions: vertex positions.
        faces: vertex indices, counter-clockwise seen from outside.
        face_part: index into `parts` of each face.
        parts: at least one.
        uv: the mesh's own texture coordinates per face corner, origin lower left; None if the file has none.
        further_uv: further sets of them, for textures that are not looked up at `uv`.

    Raises:
        AssetError: no faces, indices out of range, positions not finite, shapes that do not fit together, or a texture
            over UVs that the mesh does not have.
    """

    positions: Float[ndarray, "vertices 3"]
    faces: Int[ndarray, "faces 3"]
    face_part: Int[ndarray, " faces"]
    parts: tuple[Part, ...]
    uv: Float[ndarray, "faces 3 2"] | None = None
    further_uv: tuple[Float[ndarray, "faces 3 2"], ...] = ()

    def __post_init__(self) -> None:
        _check_triangles("mesh", self.positions, self.faces, self.face_part, self.parts)
        for uv in (self.uv, *self.further_uv):
            if uv is not None:
                _check_array("mesh uv", uv, (len(self.faces), 3, 2))
        for part in self.parts:
            last = max(given.uv_set for given in part.all_maps.values())
            if last > len(self.further_uv):
                raise AssetError(f"part {part.name!r} has a texture over UV set {last}, which the mesh does not have.")

    def uv_set(self, number: int) -> Float[ndarray, "faces 3 2"] | None:
        """`uv` for 0, and `further_uv[number - 1]` above."""
        return self.uv if number == 0 else self.further_uv[number - 1]

    @property
    def bounds(self) -> Float[ndarray, "2 3"]:
        """Lower and upper corner of the axis-aligned box around the faces; unused vertices are ignored."""
        used = self.positions[np.unique(self.faces)]
        return np.stack([used.min(axis=0), used.max(axis=0)])


@dataclass(frozen=True, eq=False)
class Surface:
    """A mesh mapped onto the unit UV square: an embedding returns it, and a renderer prepares it.

    Vertices are split wherever uv, normal or part differ, so every attribute is per vertex, as in a GPU buffer. An
    embedding may have cut and subdivided faces; `source_face` and `source_barycentric` refer to the original mesh.

    Attributes:
        positions: vertex positions in metres, the mesh's own coordinates.
        normals: unit shading normals, always made by `svbrdfgan.geometry.normals`, so that all renderers shade alike.
        uv: texture coordinates in [0, 1], origin lower left.
        faces: vertex indices, wound as in the mesh.
        face_part: index into `parts` of each face.
        parts: the mesh's parts, followed by the hidden halves of those that have hidden faces.
        elevation: any measure that grows outward along the embedding's projection. Of several points at one texel, the
            one with the greatest elevation is outermost. All zero for an injective embedding.
        source_face: face of the mesh that each face lies in.
        source_barycentric: barycentric coordinates, in that face, of each of the three corners.
        repeat: whether textures repeat beyond the unit square in u and in v, instead of clamping.
        whole_uv: of a window, the texture coordinates over the whole map, which tangents follow, so that all windows
            of a map have the same; None where `uv` is that.

    Raises:
        AssetError: shapes that do not fit together, or values that are not finite.
    """

    positions: Float[ndarray, "vertices 3"]
    normals: Float[ndarray, "vertices 3"]
    uv: Float[ndarray, "vertices 2"]
    faces: Int[ndarray, "faces 3"]
    face_part: Int[ndarray, " faces"]
    parts: tuple[Part, ...]
    elevation: Float[ndarray, " vertices"]
    source_face: Int[ndarray, " faces"]
    source_barycentric: Float[ndarray, "faces 3 3"]
    repeat: tuple[bool, bool] = (False, False)
    whole_uv: Float[ndarray, "vertices 2"] | None = None

    def __post_init__(self) -> None:
        _check_triangles("surface", self.positions, self.faces, self.face_part, self.parts)
        vertices, faces = len(self.positions), len(self.faces)
        _check_array("surface normals", self.normals, (vertices, 3))
        _check_array("surface uv", self.uv, (vertices, 2))
        _check_array("surface elevation", self.elevation, (vertices,))
        _check_array("surface source_face", self.source_face, (faces,))
        _check_array("surface source_barycentric", self.source_barycentric, (faces, 3, 3))
        if self.whole_uv is not None:
            _check_array("surface whole_uv", self.whole_uv, (vertices, 2))


def _check_array(what: str, array: ndarray, shape: tuple[int, ...]) -> None:
    if array.shape != shape:
        raise AssetError(f"{what} has shape {array.shape}; wanted {shape}.")
    if not np.isfinite(array).all():
        raise AssetError(f"{what} holds values that are not finite; repair or re-export the mesh.")


def _check_triangles(
    what: str, positions: ndarray, faces: ndarray, face_part: ndarray, parts: tuple[Part, ...]
) -> None:
    if faces.ndim != 2 or faces.shape[1] != 3 or len(faces) == 0:
        raise AssetError(f"{what} has faces of shape {faces.shape}; wanted at least one triangle, (faces, 3).")
    if not all(np.issubdtype(indices.dtype, np.integer) for indices in (faces, face_part)):
        raise AssetError(f"{what} has faces of {faces.dtype} and parts of {face_part.dtype}; wanted whole numbers.")
    _check_array(f"{what} positions", positions, (len(positions), 3))
    _check_array(f"{what} face_part", face_part, (len(faces),))
    if faces.min() < 0 or faces.max() >= len(positions):
        raise AssetError(f"{what} has faces that name vertices outside 0..{len(positions) - 1}.")
    if not parts or face_part.min() < 0 or face_part.max() >= len(parts):
        raise AssetError(f"{what} has faces that name parts outside its {len(parts)} parts.")
    names = [part.name for part in parts]
    if len(set(names)) != len(names):
        raise AssetError(f"{what} has parts that share a name: {sorted({n for n in names if names.count(n) > 1})}.")
