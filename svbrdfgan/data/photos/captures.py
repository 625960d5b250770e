"""Turns the captures of a manifest, whose cameras other programs found, into its pictures."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from svbrdfgan.config.models import validate
from svbrdfgan.data.photos.calibrated_camera import CalibratedCamera
from svbrdfgan.data.photos.check import ErrorCollector
from svbrdfgan.data.photos.colmap import read_colmap
from svbrdfgan.data.photos.frames import Frame
from svbrdfgan.data.photos.manifest import Capture, Manifest, PictureEntry
from svbrdfgan.data.photos.photo import SUFFIXES, find_mask, find_photo
from svbrdfgan.data.photos.transforms import read_transforms
from svbrdfgan.errors import AssetError, ConfigError
from svbrdfgan.utils.named_files import is_file_name

log = logging.getLogger(__name__)


def expand_captures(manifest: Manifest, base: Path, errors: ErrorCollector) -> tuple[Manifest, tuple[str, ...]]:
    """The manifest with the pictures of its captures after its own, and where the user's has each: "captures[0]".

    Args:
        base: the folder that the manifest's files are relative to.
        errors: collects what is wrong with captures, whose pictures are then left out.
    """
    pictures = list(manifest.pictures)
    labels = [f"pictures[{number}]" for number in range(len(pictures))]
    for number, capture in enumerate(manifest.captures):
        label = f"captures[{number}]"
        with errors.context(label):
            images, frames = _read(capture, base)
            for frame in frames:
                with errors.context(f"{label}: {frame.name}"):
                    pictures.append(_entry(capture, images, frame, base))
                    labels.append(label)
    return manifest.model_copy(update={"pictures": tuple(pictures)}), tuple(labels)


def _read(capture: Capture, base: Path) -> tuple[Path, Sequence[Frame]]:
    """The folder of pictures, relative to `base`, and the frames."""
    source = base / capture.cameras
    if source.suffix.lower() == ".json":
        images, frames = Path(capture.images or Path(capture.cameras).parent), read_transforms(source)
    elif capture.images is None:
        raise ConfigError("key 'images' is missing: the folder with the pictures of the COLMAP model.")
    else:
        images, frames = Path(capture.images), read_colmap(source)
    if not frames:
        raise ConfigError(f"{source} has no picture; calibrate again, or choose another of the program's models.")
    if strange := [frame.name for frame in frames if not is_file_name(frame.name)]:
        raise ConfigError(f"{source} has a picture called {strange[0][:40]!r}, which no file can be.")
    counts = Counter(str(Path(frame.name)) for frame in frames)
    repeated = sorted(name for name, count in counts.items() if count > 1)
    if repeated:
        raise ConfigError(f"{source} has several cameras of {', '.join(repeated)}; keep one of each picture.")
    if capture.images is not None:
        _warn_of_others(base, images, capture, frames)
    return images, frames


def _warn_of_others(base: Path, images: Path, capture: Capture, frames: Sequence[Frame]) -> None:
    """Warns of pictures without a camera: programs leave out those that they cannot place."""
    named = {find_photo(base / images / frame.name) for frame in frames}
    named |= {base / images / frame.mask for frame in frames if frame.mask is not None}
    found = {path for path in (base / images).rglob("*") if path.suffix.lower() in SUFFIXES}
    if capture.masks is not None:
        found = {path for path in found if base / capture.masks not in path.parents}
    others = sorted(path.name for path in found - named)
    if others:
        shown = ", ".join(others[:3]) + (", ..." if len(others) > 3 else "")
        log.warning("%s has no camera of %d pictures, which are left out: %s", capture.cameras, len(others), shown)


def _entry(capture: Capture, images: Path, frame: Frame, base: Path) -> PictureEntry:
    """The picture with its camera in the data set's axes.

    Raises:
        AssetError: its file or mask is missing.
        ConfigError: its camera cannot be used.
    """
    file = find_photo(base / images / frame.name)
    if not file.is_file():
        raise AssetError(f"{file} does not exist; delete its frame from {capture.cameras}, or correct 'images'.")
    camera = validate(CalibratedCamera, frame.camera(file), capture.cameras)
    return PictureEntry(
        file=_relative(file, base),
        mesh=capture.mesh,
        camera=camera.aligned(capture.alignment),
        mask=_mask(capture, images, frame, base),
        light_group=capture.light_group,
        turntable=capture.turntable,
    )


def _mask(capture: Capture, images: Path, frame: Frame, base: Path) -> str | None:
    if capture.masks is None:
        return None if frame.mask is None else str(images / frame.mask)
    return _relative(find_mask(base / capture.masks, frame.name), base)


def _relative(path: Path, base: Path) -> str:
    return str(path.relative_to(base) if path.is_relative_to(base) else path)
