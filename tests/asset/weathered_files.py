"""Files as the editor weathers them, and how they are compared with what they were."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from documents import differences
from full_files import FullFile
from gltf_reader import Decoders, read
from permissions import weathering

from svbrdfgan.asset.asset import Asset, load_asset
from svbrdfgan.asset.orientation import find_orientation
from svbrdfgan.asset.painters import RecipePainter
from svbrdfgan.asset.surroundings import Surroundings
from svbrdfgan.asset.verdicts import judge
from svbrdfgan.asset.weather_document import Edited, Model, Textures, weather_document
from svbrdfgan.errors import AssetError
from svbrdfgan.io.gltf.document import write_document
from svbrdfgan.io.gltf_codecs import draco, meshopt
from svbrdfgan.weathering.recipes import Recipe, RoadDirt

DECODERS = Decoders(draco.decode, meshopt.decode)
"""Those of the product, which tests of their own compare with other implementations."""
SIZES = (256, 512, 1024, 2048)
"""Texels along a side; the next one is for files whose charts do not fit."""


@dataclass(frozen=True, eq=False)
class Weathered:
    """A file of which the parts that weather were weathered.

    Attributes:
        asset: the file as it was.
        weathers: the numbers of its pieces that weather.
        path: where the weathered file is.
        size: texels along a side of its new textures.
    """

    asset: Asset
    edited: Edited
    weathers: frozenset[int]
    path: Path
    size: int

    @property
    def materials(self) -> list[int | None]:
        """The numbers of the materials of what weathers."""
        return list({self.asset.primitive(piece).get("material") for piece in self.weathers})

    @property
    def has_second_uv_set(self) -> bool:
        """Whether any material got further texture coordinates."""
        return any("TEXCOORD_" in sentence for sentence in self.edited.told)

    def differences(self) -> list[str]:
        """What differs beyond the materials that weather."""
        before, after = (read(path, DECODERS) for path in (self.asset.path, self.path))
        return differences(before, after, weathering(*self.materials))


def weathered(
    file: FullFile, folder: Path, recipe: Recipe = RoadDirt(), textures: Textures = Textures(size=256, painted=256)
) -> Weathered:
    """The file after weathering, as `weathered.glb` or `weathered.gltf` in the folder.

    Raises:
        AssetError: its charts do not even fit the largest of `SIZES`.
    """
    asset = load_asset(file.path)
    matrix = find_orientation(asset.mesh).matrix()
    weathers = frozenset(verdict.piece for verdict in judge(asset, orientation=matrix) if verdict.weathers)
    surroundings = Surroundings.of(replace(asset.mesh, positions=asset.mesh.positions @ matrix.T))
    model, painter = Model(surroundings.mesh, surroundings.reversed), RecipePainter(surroundings, recipe)
    edited, size = _fitting(asset, model, painter, weathers, textures)
    path = folder / f"weathered{file.path.suffix}"
    write_document(path, edited.document)
    return Weathered(asset, edited, weathers, path, size)


def _fitting(
    asset: Asset, model: Model, painter: RecipePainter, weathers: frozenset[int], textures: Textures
) -> tuple[Edited, int]:
    """The edited document with the smallest textures that hold all charts, and their size."""
    assert textures.size is not None
    for size in (size for size in SIZES if size >= textures.size):
        try:
            return weather_document(asset, model, painter, weathers, replace(textures, size=size)), size
        except AssetError as error:
            if "do not fit" not in str(error) or size == SIZES[-1]:
                raise
    raise AssertionError("a size above all of SIZES")
