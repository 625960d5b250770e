"""Checks users' pictures before anything is written, and collects one sentence for each error."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.data.photos.calibrated_camera import CalibratedCamera
from svbrdfgan.data.photos.manifest import Manifest, PictureEntry
from svbrdfgan.data.photos.overlay import (
    NO_PART,
    downsample,
    drawing_size,
    intersection_over_union,
    overlay,
    visible_parts,
)
from svbrdfgan.data.photos.photo import Photo, load_photo
from svbrdfgan.data.photos.rectify import minification, rectified_camera, rectify, shows_whole
from svbrdfgan.data.photos.refine import Refinement, refine_camera
from svbrdfgan.errors import AssetError, ConfigError, SvbrdfganError
from svbrdfgan.io.environment import load_environment
from svbrdfgan.io.mesh import load_mesh
from svbrdfgan.scene.description import OrbitCamera
from svbrdfgan.types import Mesh
from svbrdfgan.utils.display import Display
from svbrdfgan.utils.processes import usual_workers, worker_pool

if TYPE_CHECKING:
    from PIL.Image import Image

LEAST_IOU = 0.8
"""Intersection over union of mask and silhouette below which the user should check the camera."""

_LEAST_OVERLAP = 0.05
"""The same, below which the picture is refused."""
_FAR_DEGREES, _FAR_PERCENT = 15.0, 15.0
"""Changes of a refined camera above which the user should look at it."""
_MOST_ERRORS = 30
"""Errors that are listed: a capture may have hundreds of pictures with the same."""
_LEAST_SHARE = 8
"""Pictures that a further process must have to check, since its start takes as long as a few of them."""
_MOST_ENLARGED = 10.0
"""The greatest enlargement of a picture; more is refused."""


@dataclass
class ErrorCollector:
    """Collects errors, so that users see all of them at once."""

    source: str
    messages: list[str] = field(default_factory=list)

    @contextmanager
    def context(self, what: str) -> Iterator[None]:
        """Collects an error of the block, and goes on after the block."""
        try:
            yield
        except SvbrdfganError as error:
            self.messages += [f"{self.source}: {what}: {line}" for line in error.args]

    def raise_if_any(self) -> None:
        """Raises ConfigError with a line for each error collected, at most 30 and the number of others."""
        messages = list(dict.fromkeys(self.messages))
        if len(messages) > _MOST_ERRORS:
            further = f"{self.source}: and {len(messages) - _MOST_ERRORS} further errors."
            messages = [*messages[:_MOST_ERRORS], further]
        if messages:
            raise ConfigError(*messages)


@dataclass(frozen=True, eq=False)
class ImportJob:
    """A manifest to import, and where to report errors and progress.

    Attributes:
        manifest: with the pictures of its captures among `pictures`.
        base: the folder that the manifest's files are relative to.
        labels: where the manifest has each picture, such as "pictures[3]".
        unusable: why pictures cannot be used, by their numbers; they spoil no others.
    """

    manifest: Manifest
    base: Path
    errors: ErrorCollector
    display: Display
    labels: tuple[str, ...]
    unusable: dict[int, list[str]] = field(default_factory=dict)

    @contextmanager
    def picture(self, number: int) -> Iterator[None]:
        """Notes an error of the block, which makes the picture unusable, and goes on after the block."""
        try:
            yield
        except SvbrdfganError as error:
            start = f"{self.errors.source}: {self.labels[number]}: "
            file = self.manifest.pictures[number].file
            lines = [line if file in line else f"{file}: {line}" for line in map(str, error.args)]
            self.unusable.setdefault(number, []).extend(start + line for line in lines)

    def require_some(self, usable: Collection[int]) -> None:
        """Raises ConfigError, with a line for each error, if there were other errors or no picture to train on."""
        if self.errors.messages or not self.manifest.keeping(usable).meshes("train"):
            self.errors.messages += [line for lines in self.unusable.values() for line in lines]
            self.errors.raise_if_any()


@dataclass(frozen=True, eq=False)
class RectifiedPhoto:
    """A picture warped and resampled to the data set's camera and resolution.

    Attributes:
        camera: the data set's camera.
        film: linear RGB and coverage, both multiplied by the mask; without one, coverage is 1 inside the picture. Of a
            picture with flash, what the flash adds.
        before: the same of the clean object, if there is such a picture.
        masked: whether there is a mask.
        overlay: the picture with the outlines of mesh and mask.
        iou: intersection over union of mask and silhouette.
        refinement: how the camera was changed, if it was to be.
        doubts: what the user should check.
    """

    entry: PictureEntry
    camera: OrbitCamera
    film: Float[Tensor, "4 height width"]
    before: Float[Tensor, "4 height width"] | None
    masked: bool
    overlay: Image
    iou: float | None
    refinement: Refinement | None
    doubts: tuple[str, ...]


def check_meshes(job: ImportJob) -> dict[str, Mesh]:
    """The usable meshes, by file."""
    meshes: dict[str, Mesh] = {}
    for file in job.manifest.mesh_files:
        with job.errors.context("mesh"):
            mesh = load_mesh(job.base / file)
            mesh = replace(mesh, positions=job.manifest.mesh_alignment(file).apply(mesh.positions))
            if not any(job.manifest.learnable.selects(part) for part in mesh.parts):
                names = ", ".join(part.name for part in mesh.parts)
                raise AssetError(f"{file} has no learnable part, only {names}: change 'learnable' to select one.")
            meshes[file] = mesh
    _require_names(meshes, "meshes", job.errors)
    return meshes


def check_environments(job: ImportJob) -> None:
    """Collects the errors of the environments that pictures name."""
    files = dict.fromkeys(entry.environment for entry in job.manifest.pictures if entry.environment)
    for file in files:
        with job.errors.context("environment"):
            load_environment(job.base / file)
    _require_names(files, "environments", job.errors)


def check_pictures(job: ImportJob, meshes: Mapping[str, Mesh], workers: int | None = 1) -> dict[int, RectifiedPhoto]:
    """The rectified pictures by their numbers, in order; the job notes why others are missing.

    Args:
        workers: processes that share the pictures, as for `crew`; fewer where there are few pictures.

    Raises:
        AssetError: a process was killed.
    """
    pictures, photos = job.manifest.pictures, dict[int, RectifiedPhoto]()
    job.display.begin("pictures checked", len(pictures))
    check = _Check(job.base, meshes, job.manifest.image, job.manifest.refine_cameras)
    processes = usual_workers(workers, len(pictures) // _LEAST_SHARE)
    for number, found in enumerate(_all_checked(check, pictures, processes)):
        with job.picture(number):
            if isinstance(found, SvbrdfganError):
                raise found
            if found is not None:
                photos[number] = found
        job.display.advance()
    return photos


@dataclass(frozen=True, eq=False)
class _Check:
    """What every picture is checked and rectified by.

    Attributes:
        base: the folder that files are relative to.
        meshes: the usable ones, by file.
        film: the data set's width and height, pixels.
        refine: whether outlines correct cameras.
    """

    base: Path
    meshes: Mapping[str, Mesh]
    film: tuple[int, int]
    refine: bool

    def __call__(self, entry: PictureEntry) -> RectifiedPhoto | SvbrdfganError | None:
        """The rectified picture, or why it cannot be used; None if its mesh cannot be."""
        try:
            photo = load_photo(self.base / entry.file, None if entry.mask is None else self.base / entry.mask)
            second = None if entry.second is None else _second(self.base / entry.second, photo)
            if entry.mesh not in self.meshes:
                return None
            return _rectified(entry, photo, second, self.meshes[entry.mesh], self.film, self.refine)
        except SvbrdfganError as error:
            return error


_own: list[_Check] = []
"""The check of this process, if it is a worker."""


def _all_checked(
    check: _Check, pictures: Sequence[PictureEntry], workers: int
) -> Iterator[RectifiedPhoto | SvbrdfganError | None]:
    if workers < 2:
        yield from map(check, pictures)
        return
    with worker_pool(workers, "checks pictures", "--workers", _start, (check,)) as pool:
        yield from pool.map(_here, pictures)


def _start(check: _Check) -> None:
    _own.append(check)


def _here(entry: PictureEntry) -> RectifiedPhoto | SvbrdfganError | None:
    return _own[0](entry)


def _second(path: Path, first: Photo) -> Float[Tensor, "height width 3"]:
    photo = load_photo(path, None)
    if photo.size != first.size:
        raise AssetError(
            f"{path} is {photo.size[0]} x {photo.size[1]} pixels and the other picture of its pair {first.size[0]} x "
            f"{first.size[1]}: both must be taken alike, from one tripod."
        )
    return photo.image


def _rectified(
    entry: PictureEntry,
    photo: Photo,
    second: Float[Tensor, "height width 3"] | None,
    mesh: Mesh,
    film: tuple[int, int],
    refine: bool,
) -> RectifiedPhoto:
    camera, size, refinement = _calibrated(entry, photo), drawing_size(*photo.size), None
    if refine and photo.mask is not None and not isinstance(entry.camera, CalibratedCamera):
        pinhole, refinement = refine_camera(entry.camera.camera(), mesh, photo.mask)
        camera = CalibratedCamera.of(pinhole, photo.size)
        entry = entry.model_copy(update={"camera": camera})
    target = rectified_camera(camera, mesh, film)
    color, masked = photo.image.permute(2, 0, 1), photo.mask is not None
    inside = torch.ones(1, *color.shape[1:])
    weight = inside if photo.mask is None else photo.mask[None]
    pinhole = camera.pinhole()  # meshes have straight edges in its picture alone
    seen = rectify(downsample(torch.cat([color, weight, inside]), size), camera, pinhole, size)
    mask, shown = (seen[3:] > 0.5).numpy()
    parts = np.where(shown, visible_parts(mesh, pinhole, *size), NO_PART)
    silhouette = parts != NO_PART
    if not silhouette.any():
        raise ConfigError("the camera sees no pixel of the mesh: correct it, or the scale of the mesh (metres).")
    reduced = minification(photo.size[1], camera, target.camera(), film)
    if reduced < 1 / _MOST_ENLARGED:
        raise ConfigError(
            f"the mesh fills {silhouette.mean():.2%} of the picture as this camera sees it: correct the distance, "
            "which is in the mesh's unit, or the field of view."
        )
    iou = intersection_over_union(mask, silhouette) if masked else None
    if iou is not None and iou < _LEAST_OVERLAP:
        raise AssetError(f"the mask is not where the camera sees the mesh (IoU {iou:.2f}): correct one of them.")
    own, before = photo.image, None
    if second is not None and entry.without_flash is not None:
        own = own - second

    def warped(image: Float[Tensor, "height width 3"]) -> Float[Tensor, "4 rows cols"]:
        return rectify(torch.cat([image.permute(2, 0, 1) * weight, weight]), camera, target.camera(), film)

    if second is not None and entry.before is not None:
        before = warped(second)
    return RectifiedPhoto(
        entry=entry,
        camera=target,
        film=warped(own),
        before=before,
        masked=masked,
        overlay=overlay(seen[:3], parts, mask if masked else None),
        iou=iou,
        refinement=refinement,
        doubts=tuple(_doubts(iou, refinement, shows_whole(camera, mesh.positions), reduced)),
    )


def _calibrated(entry: PictureEntry, photo: Photo) -> CalibratedCamera:
    """The camera of the picture.

    Raises:
        ConfigError: it is that of pictures of another shape.
    """
    camera, (width, height) = entry.camera, photo.size
    if not isinstance(camera, CalibratedCamera):
        return CalibratedCamera.of(camera.camera(), photo.size)
    if abs(height * camera.size[0] / camera.size[1] - width) > 1 + width / 500:
        raise ConfigError(
            f"it is {width} x {height} pixels when upright, and its camera's pictures are {camera.size[0]:g} x "
            f"{camera.size[1]:g}: it must be those pixels, neither cropped nor turned by EXIF, or a scaled copy."
        )
    return camera


def _doubts(iou: float | None, refinement: Refinement | None, whole: bool, reduced: float) -> Iterator[str]:
    if refinement is not None and (refinement.degrees > _FAR_DEGREES or refinement.percent > _FAR_PERCENT):
        yield (
            f"its camera had to be changed by {refinement.degrees:.1f} degrees and {refinement.percent:.0f} % to fit "
            "the mask: see whether the picture shows the mesh from there"
        )
    if iou is not None and iou < LEAST_IOU:
        yield f"mask and mesh agree by {iou:.2f} only (IoU, wanted {LEAST_IOU}): correct the camera or the mask"
    if not whole:
        yield "the mesh reaches beyond the picture, which is cropped about its middle"
    if reduced < 0.95:
        yield f"the mesh is small in it and is enlarged {1 / reduced:.1f} times: use a larger one, or lower 'image'"


def _require_names(files: Iterable[str], what: str, errors: ErrorCollector) -> None:
    stems = [Path(file).stem for file in files]
    repeated = sorted({stem for stem in stems if stems.count(stem) > 1})
    if repeated:
        with errors.context(what):
            raise ConfigError(f"files share the names {repeated}; rename them, since a data set keeps assets by name.")
