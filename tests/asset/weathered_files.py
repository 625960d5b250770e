"""Files as the editor weathers them, and how they are compared with what they were."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from documents import Comparison, differences
from gltf_reader import Decoders, read
from permissions import Allowed, Change, weathering
from references import Item, Resolver, tree

from svbrdfgan.asset.asset import Asset, load_asset
from svbrdfgan.asset.orientation import find_orientation
from svbrdfgan.asset.painted_texture import Model
from svbrdfgan.asset.painters import RecipePainter
from svbrdfgan.asset.surroundings import Surroundings
from svbrdfgan.asset.verdicts import judge
from svbrdfgan.asset.weather_document import Edited, Textures, weather_document
from svbrdfgan.io.gltf.document import write_document
from svbrdfgan.io.gltf_codecs import draco, meshopt
from svbrdfgan.weathering.recipes import Recipe, RoadDirt

DECODERS = Decoders(draco.decode, meshopt.decode)
"""Those of the product, which have tests of their own."""
SMALL, DIRT = Textures(size=256, painted=256), RoadDirt()


@dataclass(frozen=True, eq=False)
class Weathered:
    """A file whose parts were weathered where they are judged to.

    Attributes:
        asset: the file as it was.
        weathers: the numbers of its pieces that were to weather.
        path: where the weathered file is.
    """

    asset: Asset
    edited: Edited
    weathers: frozenset[int]
    path: Path

    @property
    def has_second_uv_set(self) -> bool:
        """Whether any material got further texture coordinates."""
        return any("gets a second UV set" in sentence for sentence in self.edited.told)

    def differences(self) -> list[str]:
        """What differs beyond the materials that weather, and of pieces that are kept."""
        before, after = read(self.asset.path, DECODERS), read(self.path, DECODERS)
        materials = {self.asset.primitive(piece).get("material") for piece in self.weathers}
        return [*differences(before, after, weathering(*materials)), *self._touched(tree(before)[1], tree(after)[1])]

    def _touched(self, before: Resolver, after: Resolver) -> Iterator[str]:
        """What differs in primitives of pieces that are kept, though others of their material may weather."""
        unpacked = Comparison(Allowed(what=Change.DECOMPRESSION))
        for piece in set(range(len(self.asset.pieces))) - self.weathers:
            pair = (self._primitive(document, piece) for document in (before, after))
            yield from unpacked.compare(*pair, self.asset.pieces[piece].part.name)

    def _primitive(self, document: Resolver, piece: int) -> Item:
        source = self.asset.source(piece)
        found: Item = document.item("nodes", source.node).content["mesh"].content["primitives"][source.primitive]
        return found


def weathered(path: Path, folder: Path, recipe: Recipe = DIRT, textures: Textures = SMALL) -> Weathered:
    """The file after weathering, as `weathered.glb` or `weathered.gltf` in the folder."""
    asset = load_asset(path)
    matrix = find_orientation(asset.mesh).matrix()
    weathers = frozenset(verdict.piece for verdict in judge(asset, orientation=matrix) if verdict.weathers)
    surroundings = Surroundings.of(replace(asset.mesh, positions=asset.mesh.positions @ matrix.T))
    model = Model(surroundings.mesh, surroundings.reversed)
    edited = weather_document(asset, model, RecipePainter(surroundings, recipe), weathers, textures)
    out = folder / f"weathered{path.suffix}"
    write_document(out, edited.document)
    return Weathered(asset, edited, weathers, out)


def marked(changed: Weathered, path: Path) -> Path:
    """Writes the file as it was, but with red on the pieces that were to weather and black on the others, unlit.

    What is kept stays as see-through as it is; the rest is opaque.
    """
    document = changed.asset.document.copy()
    for node in document.table("nodes"):
        if "mesh" in node:
            node["mesh"] = document.add("meshes", copy.deepcopy(document.table("meshes")[node["mesh"]]))
    for piece in range(len(changed.asset.pieces)):
        source, old = changed.asset.source(piece), changed.asset.material(piece) or {}
        unlit = {"doubleSided": old.get("doubleSided", False), "extensions": {"KHR_materials_unlit": {}}}
        made = {"pbrMetallicRoughness": {"baseColorFactor": [1.0, 0.0, 0.0, 1.0]}, **unlit}
        if piece not in changed.weathers:
            pbr = old.get("pbrMetallicRoughness", {})
            black = {**pbr, "baseColorFactor": [0.0, 0.0, 0.0, pbr.get("baseColorFactor", [1.0])[-1]]}
            see_through = {key: old[key] for key in ("alphaMode", "alphaCutoff") if key in old}
            made = {"pbrMetallicRoughness": black, **see_through, **unlit}
        mesh = document.table("meshes")[document.table("nodes")[source.node]["mesh"]]
        mesh["primitives"][source.primitive] |= {"material": document.add("materials", made)}
        mesh["primitives"][source.primitive]["attributes"].pop("COLOR_0", None)
    used = document.header.setdefault("extensionsUsed", [])
    used += ["KHR_materials_unlit"] * ("KHR_materials_unlit" not in used)
    write_document(path, document)
    return path
