"""Everything that can be wrong with users' pictures, found before anything is written, one sentence each."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import torch
from jaxtyping import Bool, Float
from numpy import ndarray
from torch import Tensor

from svbrdfgan.data.photos.manifest import Manifest, PictureEntry
from svbrdfgan.data.photos.overlay import NOTHING, agreement, drawing_size, overlay, shrunk, visible_parts
from svbrdfgan.data.photos.photo import Photo, load_photo
from svbrdfgan.data.photos.rectify import frame, resample, zoom
from svbrdfgan.errors import AssetError, ConfigError, SvbrdfganError
from svbrdfgan.io import load_environment, load_mesh
from svbrdfgan.scene.description import OrbitCamera
from svbrdfgan.types import Mesh
from svbrdfgan.utils.display import Display

if TYPE_CHECKING:
    from PIL.Image import Image

LEAST_AGREEMENT = 0.8
"""Of mask and silhouette, as intersection over union, below which the camera is doubted."""

_LEAST_OVERLAP = 0.05
_MOST_ENLARGED = 10.0


@dataclass
class Faults:
    """What is wrong, gathered, so that all of it is told at once."""

    source: str
    found: list[str] = field(default_factory=list)

    @contextmanager
    def about(self, what: str) -> Iterator[None]:
        """Notes an error of the block, and goes on behind it."""
        try:
            yield
        except SvbrdfganError as error:
            self.found += [f"{self.source}: {what}: {line}" for line in str(error).splitlines()]

    def tell(self) -> None:
        """Raises ConfigError with a line for each fault, if there is any."""
        if self.found:
            raise ConfigError("\n".join(dict.fromkeys(self.found)))


@dataclass(frozen=True, eq=False)
class Order:
    """What is to be imported.

    Attributes:
        base: the folder that files of the manifest are relative to.
    """

    manifest: Manifest
    base: Path
    faults: Faults
    display: Display


@dataclass(frozen=True, eq=False)
class Shot:
    """A picture on the data set's film.

    Attributes:
        camera: the one that sees it.
        film: premultiplied linear RGB and coverage, both by the mask; where there is none, coverage says where there
            is a picture at all.
        masked: whether there is a mask.
        drawing: the picture and the mesh's outline.
        iou: agreement of mask and silhouette.
        doubts: what the user should look at.
    """

    entry: PictureEntry
    camera: OrbitCamera
    film: Float[Tensor, "4 height width"]
    masked: bool
    drawing: Image
    iou: float | None
    doubts: tuple[str, ...]


def check_meshes(order: Order) -> dict[str, Mesh]:
    """The meshes by file, those that can be used."""
    meshes: dict[str, Mesh] = {}
    for file in dict.fromkeys(entry.mesh for entry in order.manifest.pictures):
        with order.faults.about("mesh"):
            mesh = load_mesh(order.base / file)
            if not any(order.manifest.learnable.selects(part) for part in mesh.parts):
                names = ", ".join(part.name for part in mesh.parts)
                raise AssetError(f"{file} has no learnable part, only {names}: change 'learnable' so that it has.")
            meshes[file] = mesh
    _require_names(meshes, "meshes", order.faults)
    return meshes


def check_environments(order: Order) -> None:
    """Reads the environments that pictures name."""
    files = dict.fromkeys(entry.environment for entry in order.manifest.pictures if entry.environment)
    for file in files:
        with order.faults.about("environment"):
            load_environment(order.base / file)
    _require_names(files, "environments", order.faults)


def check_pictures(order: Order, meshes: Mapping[str, Mesh]) -> tuple[Shot, ...]:
    """The pictures on film: all of them, in order, if there are no faults."""
    pictures, film, faults = order.manifest.pictures, order.manifest.image, order.faults
    order.display.begin("pictures checked", len(pictures))
    shots = []
    for number, entry in enumerate(pictures):
        with faults.about(f"pictures[{number}]"):
            photo = load_photo(order.base / entry.file, None if entry.mask is None else order.base / entry.mask)
            if entry.mesh in meshes:
                with faults.about(f"pictures[{number}]: {entry.file}"):
                    shots.append(_shot(entry, photo, meshes[entry.mesh], film))
        order.display.advance()
    return tuple(shots)


def _shot(entry: PictureEntry, photo: Photo, mesh: Mesh, film: tuple[int, int]) -> Shot:
    camera, size = entry.camera.camera(), drawing_size(*photo.size)
    framed = frame(camera, photo.size, mesh, film)
    parts = visible_parts(mesh, camera, *size)
    silhouette = parts != NOTHING
    if not silhouette.any():
        raise ConfigError("the camera sees no pixel of the mesh: correct it, or the scale of the mesh (metres).")
    zoomed = zoom(photo.size[1], camera, framed.camera(), film)
    if zoomed < 1 / _MOST_ENLARGED:
        raise ConfigError(
            f"the mesh fills {silhouette.mean():.2%} of the picture as this camera sees it: correct the distance, "
            "which is in the mesh's unit, or the field of view."
        )
    color, mask, iou = photo.image.permute(2, 0, 1), None, None
    weight = torch.ones(1, *color.shape[1:])
    if photo.mask is not None:
        weight = photo.mask[None]
        mask = shrunk(weight, size)[0].numpy() > 0.5
        iou = agreement(mask, silhouette)
        if iou < _LEAST_OVERLAP:
            raise AssetError(f"the mask is not where the camera sees the mesh (IoU {iou:.2f}): correct one of them.")
    return Shot(
        entry=entry,
        camera=framed,
        film=resample(torch.cat([color * weight, weight]), camera, framed.camera(), film),
        masked=mask is not None,
        drawing=overlay(shrunk(color, size), parts, mask),
        iou=iou,
        doubts=tuple(_doubts(iou, silhouette, zoomed)),
    )


def _doubts(iou: float | None, silhouette: Bool[ndarray, "rows cols"], zoomed: float) -> Iterator[str]:
    if iou is not None and iou < LEAST_AGREEMENT:
        yield f"mask and mesh agree by {iou:.2f} only (IoU, wanted {LEAST_AGREEMENT}): correct the camera or the mask"
    if silhouette[[0, -1]].any() or silhouette[:, [0, -1]].any():
        yield "the mesh reaches beyond the picture, which is cropped about its middle"
    if zoomed < 0.95:
        yield f"the mesh is small in it and is enlarged {1 / zoomed:.1f} times: take a larger one, or a smaller 'image'"


def _require_names(files: Iterable[str], what: str, faults: Faults) -> None:
    stems = [Path(file).stem for file in files]
    doubled = sorted({stem for stem in stems if stems.count(stem) > 1})
    if doubled:
        with faults.about(what):
            raise ConfigError(f"files share the names {doubled}; rename them, since a data set keeps assets by name.")
