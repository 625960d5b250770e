"""A user's file, opened to be weathered: its asset, where its nose is, and which of its pieces weather."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from glob import escape

from svbrdfgan.asset.asset import Asset, load_asset
from svbrdfgan.asset.masks import Mask, MeshMask, masked_pieces
from svbrdfgan.asset.orientation import Orientation, axes, find_orientation
from svbrdfgan.asset.part_substances import face_substances, settled
from svbrdfgan.asset.surroundings import Surroundings
from svbrdfgan.asset.verdicts import Verdict, judge, warnings
from svbrdfgan.config.choices import PartSelection
from svbrdfgan.types import Mesh
from svbrdfgan.weathering.substances import Substance


@dataclass(frozen=True, eq=False)
class Workpiece:
    """An asset and what was found out about it.

    Attributes:
        asset: without the faces of the ground that some files have under their model.
        verdicts: on each piece of the asset.
        warnings: sentences for the user.
        masks: on the asset's mesh, which say where a layer may lie.
        length: of the model in metres, if it is known.
    """

    asset: Asset
    orientation: Orientation
    verdicts: tuple[Verdict, ...]
    warnings: tuple[str, ...]
    masks: tuple[MeshMask, ...] = ()
    length: float | None = None

    @property
    def weathered(self) -> frozenset[int]:
        """The numbers of the pieces that weather."""
        return frozenset(verdict.piece for verdict in self.verdicts if verdict.weathers and verdict.area > 0.0)

    @property
    def selection(self) -> PartSelection:
        """The parts of the mesh of which a piece weathers, for what knows no pieces."""
        names = {self.asset.pieces[piece].part.name for piece in self.weathered}
        return PartSelection(include=tuple(sorted(map(escape, names))), exclude=())

    @cached_property
    def mesh(self) -> Mesh:
        """The asset's mesh with its roof at +Y and its nose at +Z."""
        return turned(self.asset.mesh, self.orientation)

    @cached_property
    def surroundings(self) -> Surroundings:
        return Surroundings.of(self.mesh, face_substances(self.asset, self.verdicts, self.mesh), self.length)

    def settled(self, settles_on: Mapping[Substance, float]) -> Workpiece:
        """The same workpiece, of which also weathers what such matter lies on (`settled`)."""
        return replace(self, verdicts=settled(self.verdicts, settles_on))


def open_workpiece(
    path: str | os.PathLike[str],
    *,
    learnable: Sequence[str] = (),
    keep: Sequence[str] = (),
    masks: Sequence[str] = (),
    front: str | None = None,
    up: str | None = None,
    length: float | None = None,
) -> Workpiece:
    """The workpiece in a mesh file.

    Args:
        learnable, keep: patterns, as for `judge`.
        masks: words, as for `Mask.read`: where a layer may lie. What they lie on weathers wherever they let it.
        front, up: nose and roof, as for `find_orientation`; by default they are found.
        length: of the model in metres, by which recipes size their patterns; by default as `likely_length` says.

    Raises:
        AssetError: as for `load_asset`, or a mask's picture cannot be read.
        ConfigError: `front` or `up` is no axis, or a mask lies on nothing.
    """
    front, up = axes(front, up)
    read = [Mask.read(word) for word in masks]
    asset = load_asset(path)
    orientation = find_orientation(asset.mesh, front=front, up=up)
    masked = masked_pieces(asset, read)
    verdicts = judge(asset, orientation=orientation.matrix(), learnable=learnable, keep=keep, masked=masked)
    doubts, asset = tuple(warnings(verdicts, asset)), above_ground(asset, verdicts)
    return Workpiece(asset, orientation, verdicts, doubts, tuple(mask.on(asset) for mask in read), length)


def above_ground(asset: Asset, verdicts: Sequence[Verdict]) -> Asset:
    """The asset without the faces of pieces that are ground; as it is if there is nothing else."""
    ground = {verdict.piece for verdict in verdicts if verdict.kind == "ground" and not verdict.weathers}
    return asset.without(ground if len(ground) < len(asset.pieces) else ())


def turned(mesh: Mesh, orientation: Orientation) -> Mesh:
    """A mesh in the axes of its file, turned to the project's."""
    return replace(mesh, positions=mesh.positions @ orientation.matrix().T)
