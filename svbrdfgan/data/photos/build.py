"""From a manifest to a data set's folder: whole, or not there at all."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

from svbrdfgan.data.gather import INDEX, gather_environments, match_files
from svbrdfgan.data.photos.check import Faults, Order, Shot, check_environments, check_meshes, check_pictures
from svbrdfgan.data.photos.convert import develop, places
from svbrdfgan.data.photos.manifest import Manifest
from svbrdfgan.data.photos.overlay import contact_sheet
from svbrdfgan.data.sampler import EnvironmentAsset
from svbrdfgan.errors import AssetError, ConfigError
from svbrdfgan.plugins import load_embedding
from svbrdfgan.utils.display import Display, SilentDisplay

OVERLAYS, SHEET, RECORD = "overlay", "contact-sheet.png", "imported.json"


@dataclass(frozen=True)
class Imported:
    """What became of one picture.

    Attributes:
        file: as the manifest names it.
        overlay: its drawing, in the data set's folder.
        exemplar: its place there, such as "train/000003".
        iou: agreement of mask and silhouette; None without a mask.
        exposure: what its linear values were multiplied by; None where only overlays were made.
        doubts: what the user should look at.
    """

    file: str
    overlay: str
    exemplar: str
    iou: float | None
    exposure: float | None
    doubts: tuple[str, ...]


def import_pictures(
    manifest: Manifest,
    folder: Path,
    *,
    base: Path,
    source: str = "manifest",
    preview: bool = False,
    display: Display | None = None,
) -> tuple[Imported, ...]:
    """Makes a data set of pictures, with an overlay of mesh and picture for each.

    Args:
        base: the folder that files of the manifest are relative to.
        source: opens every message.
        preview: makes the overlays alone.

    Raises:
        ConfigError: a line for each fault of the manifest or of what it names; or the folder is not free.
        AssetError: the disk cannot be written.
    """
    _require_free(folder)
    faults = Faults(source)
    order = Order(manifest, base, faults, display or SilentDisplay())
    with _stage(folder) as stage:
        meshes = check_meshes(order)
        check_environments(order)
        with faults.about("embedding"):
            load_embedding(manifest.embedding.name, manifest.embedding.options)
        pool: tuple[EnvironmentAsset, ...] = ()
        with faults.about("environments"):
            files = match_files(manifest.environments.files, base)
            pool = gather_environments(manifest.environments, files, manifest.environment_rows, stage)
        shots = check_pictures(order, meshes)
        faults.tell()
        exposures: Sequence[float | None] = [None] * len(shots)
        if not preview:
            exposures = develop(order, meshes, pool, shots, stage)
            faults.tell()
        told = _told(manifest, shots, exposures)
        _draw(stage, shots, told)
        kept = [OVERLAYS] if preview else [OVERLAYS, RECORD, "assets", "cache", *manifest.config().splits, INDEX]
        (stage / RECORD).write_text(json.dumps([asdict(one) for one in told], indent=1) + "\n", encoding="utf-8")
        _publish(stage, folder, kept)
    return told


def _told(manifest: Manifest, shots: Sequence[Shot], exposures: Sequence[float | None]) -> tuple[Imported, ...]:
    return tuple(
        Imported(
            file=shot.entry.file,
            overlay=f"{OVERLAYS}/{number:04d}.png",
            exemplar=f"{split}/{index:06d}",
            iou=shot.iou,
            exposure=exposures[number],
            doubts=shot.doubts,
        )
        for number, (shot, (split, index)) in enumerate(zip(shots, places(manifest), strict=True))
    )


def _draw(folder: Path, shots: Sequence[Shot], told: Sequence[Imported]) -> None:
    """The overlays and the sheet of all of them."""
    (folder / OVERLAYS).mkdir()
    for shot, one in zip(shots, told, strict=True):
        shot.drawing.save(folder / one.overlay)
    captions = [f"{Path(one.file).name}{'' if one.iou is None else f'  IoU {one.iou:.2f}'}" for one in told]
    contact_sheet([shot.drawing for shot in shots], captions).save(folder / OVERLAYS / SHEET)


def _require_free(folder: Path) -> None:
    """Nothing of the user's is overwritten: the folder may hold the overlays of a preview alone."""
    if folder.is_file() or (folder.is_dir() and {path.name for path in folder.iterdir()} - {OVERLAYS}):
        raise ConfigError(
            f"{folder} is there already and holds other things than overlays; choose another or delete it."
        )


@contextmanager
def _stage(folder: Path) -> Iterator[Path]:
    """A folder beside the wanted one, for all that is not yet known to be good; gone when the block ends."""
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{folder.name}-", dir=folder.parent) as stage:
            yield Path(stage)
    except OSError as error:
        raise AssetError(f"{folder} cannot be written ({error.strerror or error}); choose another place.") from error


def _publish(stage: Path, folder: Path, names: Sequence[str]) -> None:
    """Moves what was made to where it is wanted, the plan last: it is what makes the folder a data set."""
    folder.mkdir(exist_ok=True)
    shutil.rmtree(folder / OVERLAYS, ignore_errors=True)
    for name in names:
        os.replace(stage / name, folder / name)
