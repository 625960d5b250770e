"""Two squares in a document, and a painter of their right half: what tests of the editor share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from documents import differences
from gltf_reader import read
from numpy import ndarray
from permissions import weathering
from PIL import Image

from svbrdfgan.asset.asset import Asset, load_asset
from svbrdfgan.asset.painted_texture import Model
from svbrdfgan.asset.painters import Paint
from svbrdfgan.asset.points import SurfacePoints
from svbrdfgan.asset.weather_document import Edited, Textures, weather_document
from svbrdfgan.io.gltf.accessors import append_accessor
from svbrdfgan.io.gltf.document import Document, write_document
from svbrdfgan.io.gltf_codecs.plain import INDICES
from svbrdfgan.types import FURTHER_MAPS, Mesh

RED, BLUE = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Halves:
    """Paints solid red where x > 0, and nothing elsewhere."""

    mesh: Mesh
    alpha: float = 1.0

    maps: ClassVar = FURTHER_MAPS

    def __call__(self, points: SurfacePoints, texel: float) -> Paint:
        alpha = self.alpha * (points.positions(self.mesh)[:, 0] > 0.0)
        color, zero = np.tile(RED, (len(points), 1)), np.zeros(len(points))
        return Paint(color, alpha, np.full(len(points), 0.25), zero, zero)


def square(document: Document, x: float, *, uv: ndarray | None) -> dict[str, int]:
    """Attributes of a square of side 1 whose left edge is at x."""
    corners = np.array([[x, 0, 0], [x + 1, 0, 0], [x + 1, 1, 0], [x, 1, 0]], "<f4")
    attributes = {"POSITION": append_accessor(document, corners, bounds=True)}
    if uv is not None:
        attributes["TEXCOORD_0"] = append_accessor(document, uv.astype("<f4"))
    return attributes


UNIT = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], float)
LEFT, RIGHT = UNIT * (0.5, 1.0), UNIT * (0.5, 1.0) + (0.5, 0.0)


def two_squares(path: Path, *, uv: tuple[ndarray | None, ndarray | None], materials: tuple[int, int]) -> Asset:
    """An asset of a square at x in [-1, 0] and one at [0, 1], in two nodes; the first material has a blue texture."""
    document = Document({"asset": {"version": "2.0", "copyright": "somebody"}, "extras": {"kept": 1}}, [], path)
    stream = BytesIO()
    Image.new("RGB", (32, 32), (0, 0, 255)).save(stream, format="PNG")
    document.add("images", {"bufferView": document.add_view(stream.getvalue()), "mimeType": "image/png"})
    document.add("textures", {"source": 0})
    gloss = {"metallicFactor": 0.5, "roughnessFactor": 1.0}
    document.add("materials", {"name": "paint", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, **gloss}})
    document.add("materials", {"name": "other", "doubleSided": True, "extras": {"id": 7}})
    index = append_accessor(document, np.array([0, 1, 2, 0, 2, 3], "<u4"), target=INDICES)
    for number, x in enumerate((-1.0, 0.0)):
        attributes = square(document, x, uv=uv[number])
        primitive = {"attributes": attributes, "indices": index, "material": materials[number]}
        document.add("nodes", {"name": f"node{number}", "mesh": document.add("meshes", {"primitives": [primitive]})})
    document.header |= {"scene": 0, "scenes": [{"nodes": [0, 1]}]}
    write_document(path, document)
    return load_asset(path)


def weathered(asset: Asset, *pieces: int, size: int | None = None, alpha: float = 1.0) -> Edited:
    model = Model(asset.mesh, np.zeros(len(asset.mesh.faces), bool))
    return weather_document(asset, model, Halves(asset.mesh, alpha), pieces, Textures(size=size, painted=512))


def found(edited: Edited, asset: Asset, path: Path, *materials: str) -> list[str]:
    """What differs beyond these materials."""
    write_document(path, edited.document)
    return differences(read(asset.path), read(path), weathering(*materials))


def picture(edited: Edited, material: int, key: str = "baseColorTexture") -> ndarray:
    entry = edited.document.table("materials")[material]
    return shown(edited.document, (entry["pbrMetallicRoughness"] | entry)[key])


def shown(document: Document, info: dict[str, Any]) -> ndarray:
    """The picture of a `textureInfo`."""
    texture = document.table("textures")[info["index"]]
    view = document.table("images")[texture["source"]]["bufferView"]
    return np.asarray(Image.open(BytesIO(bytes(document.views[view]))))


def add_picture(document: Document, pixels: ndarray, **texture: Any) -> int:
    """The index of a new texture."""
    stream = BytesIO()
    Image.fromarray(pixels.astype(np.uint8)).save(stream, format="PNG")
    image = document.add("images", {"bufferView": document.add_view(stream.getvalue()), "mimeType": "image/png"})
    return document.add("textures", {"source": image, **texture})


def altered(asset: Asset, change: Callable[[Document], None]) -> Asset:
    """The asset in a file of its own, after a change of its document."""
    document, path = asset.document.copy(), asset.path.with_name("altered.glb")
    change(document)
    write_document(path, document)
    return load_asset(path)
