"""The looks of a part: what its material says, averaged over the UVs that the part really uses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from svbrdfgan.asset.asset import Asset
from svbrdfgan.io.gltf.document import Json
from svbrdfgan.io.gltf.materials import DocumentPictures
from svbrdfgan.io.materials import Pictures
from svbrdfgan.io.uv_sets import UVSet
from svbrdfgan.types import FileMap

_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


@dataclass(frozen=True)
class Looks:
    """Means over a part; all but emission lie in [0, 1].

    Attributes:
        color: linear RGB.
        varied: standard deviation of the luminance, which is greater than 0 where a texture paints something.
        roughness, metallic: None where the material states neither.
        alpha: 1 where the material is opaque, whatever its texture holds.
        blended: whether the material blends by alpha.
        transmission: how much light passes.
        emission: luminance of the emitted light.
        sheen: whether it has the sheen of cloth.
    """

    color: tuple[float, float, float]
    varied: float
    roughness: float | None
    metallic: float | None
    alpha: float
    blended: bool
    transmission: float
    emission: float
    sheen: bool = False

    @property
    def luminance(self) -> float:
        return float(np.dot(self.color, _LUMINANCE))

    @property
    def saturation(self) -> float:
        return (max(self.color) - min(self.color)) / max(*self.color, 1e-6)


class PartLooks:
    """Looks up materials of an asset at points of its faces; each picture is decoded once."""

    def __init__(self, asset: Asset) -> None:
        self.asset = asset
        self.pictures, self.decoded = DocumentPictures(asset.document), Pictures(asset.path)

    def of(self, piece: int, face: Int[ndarray, " points"], weight: Float[ndarray, "points 3"]) -> Looks:
        """The means over points of the faces of a part, one of whose pieces this is."""
        part, material = self.asset.pieces[piece].part, self.asset.material(piece) or {}
        values = {name: self._values(given, face, weight) for name, given in part.all_maps.items()}
        color = values["base_color"].mean(axis=0)
        stated = {name: float(values[name].mean()) for name in ("roughness", "metallic") if name in values}
        return Looks(
            (float(color[0]), float(color[1]), float(color[2])),
            float((values["base_color"] @ _LUMINANCE).std()),
            stated.get("roughness"),
            stated.get("metallic"),
            float(values["alpha"].mean()) if "alpha" in values else 1.0,
            material.get("alphaMode") == "BLEND",
            self._transmission(piece, material, face, weight),
            self._emission(piece, material, face, weight),
            any(material.get("extensions", {}).get("KHR_materials_sheen", {}).get("sheenColorFactor", ())),
        )

    def _values(
        self, given: FileMap, face: Int[ndarray, " points"], weight: Float[ndarray, "points 3"]
    ) -> Float[ndarray, "points channels"]:
        """A map of the mesh's part at the points."""
        whole = np.broadcast_to(np.array(given.factor), (len(face), len(given.factor)))
        uv = self.asset.mesh.uv_set(given.uv_set) if given.texture is not None else None
        if given.texture is not None and uv is not None:
            whole = whole * nearest(given.texture, np.einsum("pk,pki->pi", weight, uv[face]))
        return whole if given.cutoff is None else (whole >= given.cutoff).astype(np.float64)

    def _transmission(self, piece: int, material: Json, face: ndarray, weight: ndarray) -> float:
        stated = material.get("extensions", {}).get("KHR_materials_transmission", {})
        factor = float(stated.get("transmissionFactor", 0.0))
        found = self._extra(piece, stated.get("transmissionTexture"), face, weight) if factor else None
        return factor if found is None else factor * float(found[:, 0].mean())

    def _emission(self, piece: int, material: Json, face: ndarray, weight: ndarray) -> float:
        factor = np.array(material.get("emissiveFactor", (0.0, 0.0, 0.0)), np.float64)
        stated = material.get("extensions", {}).get("KHR_materials_emissive_strength", {})
        factor *= float(stated.get("emissiveStrength", 1.0))
        found = self._extra(piece, material.get("emissiveTexture"), face, weight) if factor.any() else None
        return float((factor if found is None else (factor * found).mean(axis=0)) @ _LUMINANCE)

    def _extra(
        self, piece: int, info: Json | None, face: Int[ndarray, " points"], weight: Float[ndarray, "points 3"]
    ) -> Float[ndarray, "points 3"] | None:
        """Linear RGB of a texture that parts of meshes do not have; None if there is none."""
        texture = self.decoded.color(self.pictures.of(info))
        if info is None or texture is None:
            return None
        moved = UVSet.of(info)
        uv = self.asset.uv(piece, moved.number)
        if uv is None:
            return None
        known = self.asset.face_piece[face] == piece
        corners = moved.moved(uv)[self.asset.corner_vertices[face[known]]]
        return nearest(texture, np.einsum("pk,pki->pi", weight[known], corners)) if known.any() else None


def nearest(
    texture: Float[ndarray, "rows cols channels"], uv: Float[ndarray, "points 2"]
) -> Float[ndarray, "points channels"]:
    """The texel at each point of a texture that repeats; row 0 is at v = 0. What is not finite becomes 0."""
    rows, cols = texture.shape[:2]
    within = np.mod(np.where(np.isfinite(uv), uv, 0.0), 1.0)
    col, row = (np.floor(within[:, k] * size).astype(np.int64) for k, size in ((0, cols), (1, rows)))
    return np.asarray(texture[np.minimum(row, rows - 1), np.minimum(col, cols - 1)], np.float64)
