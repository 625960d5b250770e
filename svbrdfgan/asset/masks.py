"""The user's masks: where on the surface a layer may lie."""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from numpy import ndarray
from torch import Tensor

from svbrdfgan.asset.asset import Asset
from svbrdfgan.asset.painters import Paint, Painter
from svbrdfgan.asset.points import SurfacePoints
from svbrdfgan.errors import ConfigError
from svbrdfgan.geometry.cells import ranges
from svbrdfgan.geometry.rasterize import triangle_fragments
from svbrdfgan.geometry.texels import sample_texture
from svbrdfgan.io.gltf.primitives import vertex_floats
from svbrdfgan.io.image import EIGHT_BIT, FLOAT, load_grey

_UVS = "TEXCOORD_0"
_ATTRIBUTE = re.compile(r"_\w+|COLOR_\d+")
_COARSE = 1024  # texels along a side at which parts are searched for places that a picture leaves free
_TILES = 4  # along a side, of a picture that repeats on one face: more of them show nothing new


@dataclass(frozen=True, eq=False)
class Mask:
    """One mask, for any file.

    Attributes:
        word: the user's.
        pattern: over names of materials.
        attribute: of vertices, which holds the mask's values or, for a picture, the UVs.
        picture: 1 where the layer may lie and 0 where it may not, row 0 at v = 0; None if the attribute says it.
    """

    word: str
    pattern: str
    attribute: str
    picture: Float[Tensor, "rows cols 1"] | None = None

    @classmethod
    def read(cls, word: str) -> Mask:
        """The mask of a word: FILE.png, _NAME or COLOR_n, or one of them after MATERIAL=.

        Raises:
            ConfigError: the word is not of such a form.
            AssetError: the picture cannot be read.
        """
        pattern, given, what = word.partition("=")
        if not given or os.path.exists(word):
            pattern, what = "*", word
        if what.lower().endswith((*EIGHT_BIT, *FLOAT)):
            return cls(word, pattern, _UVS, load_grey(what).flip(0)[..., None])
        if not _ATTRIBUTE.fullmatch(what):
            raise ConfigError(
                f"the mask '{word}' is neither a picture ({', '.join(EIGHT_BIT + FLOAT)}) nor a vertex attribute such "
                "as _NAME or COLOR_1; MATERIAL= may stand before it."
            )
        return cls(word, pattern, what)

    def on(self, asset: Asset) -> MeshMask:
        """The mask on an asset's mesh: on pieces that have the attribute and a material of such a name.

        Raises:
            ConfigError: there is no such piece.
        """
        named = [piece for piece in range(len(asset.pieces)) if _matches(_material_name(asset, piece), self.pattern)]
        covered = [piece for piece in named if self.attribute in asset.primitive(piece)["attributes"]]
        if not covered:
            raise ConfigError(
                f"the mask '{self.word}' lies on nothing of {asset.path.name}: {self._lack(asset, named)}."
            )
        corners = np.zeros((len(asset.mesh.faces), 3, 1 if self.picture is None else 2))
        for piece in covered:
            mine = asset.faces(piece)
            corners[mine] = self._values(asset, piece)[asset.corner_vertices[mine]]
        return MeshMask(np.isin(asset.face_piece, covered), corners, self.picture)

    def _values(self, asset: Asset, piece: int) -> Float[ndarray, "vertices components"]:
        """Of the attribute: UVs, or a number in [0, 1]."""
        if self.picture is not None and (uv := asset.uv(piece, 0)) is not None:
            return np.nan_to_num(uv)
        stored = vertex_floats(asset.document, asset.primitive(piece), self.attribute)
        return np.clip(np.nan_to_num(stored[:, :1]), 0.0, 1.0)

    def _lack(self, asset: Asset, named: Sequence[int]) -> str:
        if not named:
            names = dict.fromkeys(_material_name(asset, piece) for piece in range(len(asset.pieces)))
            return f"no material's name matches '{self.pattern}', of {', '.join(names)}"
        if self.picture is not None:
            return "a picture needs UVs, and these parts have none"
        found = {name for piece in named for name in asset.primitive(piece)["attributes"]}
        return f"no part has the vertex attribute {self.attribute}, but {', '.join(sorted(found))}"


@dataclass(frozen=True, eq=False)
class MeshMask:
    """A mask on one mesh.

    Attributes:
        covered: the faces that it lies on.
        corners: of the faces: the mask's values, or UVs of its picture, which repeats.
        picture: as of `Mask`.
    """

    covered: Bool[ndarray, " faces"]
    corners: Float[ndarray, "faces 3 components"]
    picture: Float[Tensor, "rows cols 1"] | None

    def __call__(self, points: SurfacePoints) -> Float[ndarray, " points"]:
        """The share of a layer that may lie at points, in [0, 1]; 1 where there is no mask."""
        at = points.interpolate(self.corners)
        if self.picture is None:
            return np.where(self.covered[points.face], at[:, 0], 1.0)
        found = sample_texture(self.picture, torch.from_numpy(at), (True, True))[:, 0].numpy()
        return np.where(self.covered[points.face], found, 1.0)

    def free_pieces(self, face_piece: Int[ndarray, " faces"]) -> set[int]:
        """The pieces on which the mask is above 0 anywhere.

        Of a picture, a texel counts where its centre lies in a face, or a face's centre in it.
        """
        if self.picture is None:
            return set(face_piece[self.covered & (self.corners > 0.0).any(axis=(1, 2))].tolist())
        most = _coarser(self.picture[..., 0].numpy())
        size = np.array(most.shape[::-1])
        col, row = np.floor(self.corners.mean(axis=1) % 1.0 * size).astype(np.int64).T % size[:, None]
        free = set(face_piece[self.covered & (most[row, col] > 0.0)].tolist())
        rest = np.flatnonzero(self.covered & ~np.isin(face_piece, list(free)))
        face, uv = _tiles(self.corners[rest])
        shown, texel, _ = triangle_fragments(uv * size - 0.5, *most.shape)
        return free | set(face_piece[rest[face[shown[most.ravel()[texel] > 0.0]]]].tolist())


@dataclass(frozen=True, eq=False)
class MaskedPainter:
    """Paints what another painter does, as far as all masks let it."""

    painter: Painter
    masks: Sequence[MeshMask]

    @property
    def maps(self) -> Collection[str]:
        return self.painter.maps

    def __call__(self, points: SurfacePoints, texel: float) -> Paint:
        paint, alpha = self.painter(points, texel), np.ones(len(points))
        for mask in self.masks:
            alpha *= mask(points)
        return replace(paint, alpha=paint.alpha * alpha)


def masked_pieces(asset: Asset, masks: Sequence[Mask]) -> dict[int, bool]:
    """For each piece that a mask lies on, whether all its masks are above 0 somewhere.

    Raises:
        ConfigError: a mask lies on nothing.
    """
    found: dict[int, bool] = {}
    for mask in masks:
        lying = mask.on(asset)
        free = lying.free_pieces(asset.face_piece)
        for piece in np.unique(asset.face_piece[lying.covered]).tolist():
            found[piece] = found.get(piece, True) and piece in free
    return found


def _coarser(picture: Float[ndarray, "rows cols"]) -> Float[ndarray, "coarse_rows coarse_cols"]:
    """The greatest values in a picture's squares, of which there are at most 1024 along a side."""
    for axis in (0, 1):
        side = picture.shape[axis]
        starts = np.linspace(0, side, min(side, _COARSE), endpoint=False).astype(np.int64)
        picture = np.maximum.reduceat(picture, starts, axis=axis)
    return picture


def _tiles(uv: Float[ndarray, "faces 3 2"]) -> tuple[Int[ndarray, " copies"], Float[ndarray, "copies 3 2"]]:
    """Each face as often as it touches tiles, moved so that each of these is the first: its number, and UVs."""
    moved = uv - np.floor(uv.min(axis=1, keepdims=True))
    count = np.minimum(np.floor(moved.max(axis=1)).astype(np.int64) + 1, _TILES)
    face, tile = ranges(np.zeros(len(uv), np.int64), count.prod(axis=1))
    row, col = np.divmod(tile, count[face, 0])
    return face, moved[face] - np.stack([col, row], axis=1)[:, None]


def _material_name(asset: Asset, piece: int) -> str:
    return str((asset.material(piece) or {}).get("name") or asset.pieces[piece].part.name)


def _matches(name: str, pattern: str) -> bool:
    return fnmatchcase(name.lower(), pattern.lower())
