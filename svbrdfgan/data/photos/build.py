"""Makes the folder of a data set from a manifest. The folder appears whole or not at all."""

from __future__ import annotations

import json
import logging
import os
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from svbrdfgan.data.gather import gather_environments, match_files
from svbrdfgan.data.index import INDEX
from svbrdfgan.data.photos.captures import expand_captures
from svbrdfgan.data.photos.check import (
    ErrorCollector,
    ImportJob,
    RectifiedPhoto,
    check_environments,
    check_meshes,
    check_pictures,
)
from svbrdfgan.data.photos.convert import Imported, convert_photos, places
from svbrdfgan.data.photos.light_balls import beside
from svbrdfgan.data.photos.manifest import Manifest
from svbrdfgan.data.photos.overlay import contact_sheet
from svbrdfgan.data.photos.refine import Refinement
from svbrdfgan.data.sampler import EnvironmentAsset
from svbrdfgan.data.trained_model import TrainedModel
from svbrdfgan.errors import ConfigError
from svbrdfgan.io.atomic import folder_beside
from svbrdfgan.io.claims import claimed_folder
from svbrdfgan.models.shipped import model_folder
from svbrdfgan.plugins.registry import load_embedding
from svbrdfgan.scene.description import Scene
from svbrdfgan.scene.loader import SceneLoader
from svbrdfgan.utils.display import Display, SilentDisplay

OVERLAYS = "overlay"
SHEET = "contact-sheet.png"
RECORD = "imported.json"

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class ImportedPicture:
    """The record of an imported picture.

    Attributes:
        file: as the manifest names it.
        overlay: path of its overlay in the data set's folder.
        exemplar: its place there, such as "train/000003".
        iou: intersection over union of mask and silhouette; None without a mask.
        refinement: how its camera was changed; None if it was not to be.
        exposure: the factor on its linear values; None where only overlays were made.
        uncertainty: by how much its reflectance is off, to judge by imports of simulated pictures, as a mean absolute
            logarithm; None where none were simulated.
        doubts: what the user should check.
    """

    file: str
    overlay: str
    exemplar: str
    iou: float | None
    refinement: Refinement | None
    exposure: float | None
    uncertainty: float | None
    doubts: tuple[str, ...]


def import_pictures(
    manifest: Manifest,
    folder: Path,
    *,
    base: Path,
    source: str = "manifest",
    preview: bool = False,
    workers: int | None = 1,
    display: Display | None = None,
) -> tuple[ImportedPicture, ...]:
    """Makes a data set of pictures, with an overlay of mesh and picture for each.

    Args:
        base: the folder that the manifest's files are relative to.
        source: the name of the manifest, which opens every message.
        preview: makes only the overlays.
        workers: processes that share the pictures; None for one on each core, but at most 8. More than one are
            spawned, so a script that asks for them needs its `if __name__ == "__main__"`.

    Raises:
        ConfigError: the manifest or files that it names have errors, one line each; or the folder is in use.
        AssetError: the folder cannot be written, or the manifest's model cannot be read.
    """
    with claimed_folder(folder):
        _require_free(folder)
        errors = ErrorCollector(source)
        manifest, labels = expand_captures(manifest, base, errors)
        model = _expected(manifest, base)
        job = ImportJob(manifest, base, errors, display or SilentDisplay(), labels)
        with folder_beside(folder) as stage:
            meshes = check_meshes(job)
            check_environments(job)
            with errors.context("embedding"):
                load_embedding(manifest.embedding.name, manifest.embedding.options)
            pool: tuple[EnvironmentAsset, ...] = ()
            with errors.context("environments"):
                files = match_files(manifest.environments.files, base)
                pool = gather_environments(manifest.environments, files, manifest.environment_rows, stage)
            usable = check_pictures(job, meshes, workers)
            job.require_some(usable)
            photos = list(usable.values())
            _warn(job)
            job = replace(
                job, manifest=manifest.keeping(usable), labels=tuple(labels[number] for number in usable), unusable={}
            )
            found: Mapping[int, Imported | None] = dict.fromkeys(range(len(photos)))
            if not preview:
                found = convert_photos(job, meshes, pool, photos, stage, model, workers)
                _warn(job)
            manifest, photos = job.manifest.keeping(found), [photos[number] for number in sorted(found)]
            records = _records(manifest, photos, [found[number] for number in sorted(found)])
            job.display.stage("drawing overlays", len(photos))
            _draw(stage, photos, records, job.display)
            kept = [OVERLAYS] if preview else [OVERLAYS, RECORD, "assets", "cache", *manifest.config().splits, INDEX]
            (stage / RECORD).write_text(
                json.dumps([asdict(record) for record in records], indent=1) + "\n", encoding="utf-8"
            )
            _publish(stage, folder, kept)
        return records


def _warn(job: ImportJob) -> None:
    """A warning for each picture that is left out."""
    for lines in job.unusable.values():
        for line in lines:
            log.warning("%s", line)
    if job.unusable:
        log.warning("%d of %d pictures are left out", len(job.unusable), len(job.manifest.pictures))


def _expected(manifest: Manifest, base: Path) -> TrainedModel | None:
    """The model that says which weathering to expect, if one does."""
    if manifest.model is None:
        return None
    model = TrainedModel.open(model_folder(manifest.model, base), "model")
    wanted, known = manifest.embedding.model_dump(), model.trained_on.embedding.model_dump()
    if wanted != known:
        raise ConfigError(f"model: it was trained with the embedding {known}, not {wanted}: give both the same.")
    return model


def _records(
    manifest: Manifest, photos: Sequence[RectifiedPhoto], found: Sequence[Imported | None]
) -> tuple[ImportedPicture, ...]:
    return tuple(
        ImportedPicture(
            file=photo.entry.file,
            overlay=f"{OVERLAYS}/{number:04d}.png",
            exemplar=f"{split}/{index:06d}",
            iou=photo.iou,
            refinement=photo.refinement,
            exposure=None if made is None else made.exposure,
            uncertainty=None if made is None else made.uncertainty,
            doubts=photo.doubts,
        )
        for number, (photo, made, (split, index)) in enumerate(zip(photos, found, places(manifest), strict=True))
    )


def _draw(folder: Path, photos: Sequence[RectifiedPhoto], records: Sequence[ImportedPicture], display: Display) -> None:
    """Writes the overlays and a contact sheet of all of them; with its light beside each, once that is known."""
    (folder / OVERLAYS).mkdir()
    loader, shown = SceneLoader(folder), []
    for photo, record in zip(photos, records, strict=True):
        overlay = photo.overlay
        if record.exposure is not None:
            view = loader.view(Scene.load(folder / f"{record.exemplar}.json"))
            overlay = beside(overlay, view.environment, view.camera)
        overlay.save(folder / record.overlay)
        shown.append(overlay)
        display.advance()
    captions = [
        f"{Path(record.file).name}{'' if record.iou is None else f'  IoU {record.iou:.2f}'}" for record in records
    ]
    contact_sheet(shown, captions).save(folder / OVERLAYS / SHEET)


def _require_free(folder: Path) -> None:
    # so that no file of the user's is overwritten; a preview leaves its overlays there
    if folder.is_file() or (folder.is_dir() and {path.name for path in folder.iterdir()} - {OVERLAYS}):
        raise ConfigError(f"{folder} already exists and holds more than overlays; choose another folder or delete it.")


def _publish(stage: Path, folder: Path, names: Sequence[str]) -> None:
    """Moves these entries to the final folder, in order: the plan, which makes the folder a data set, must be last."""
    folder.mkdir(exist_ok=True)
    shutil.rmtree(folder / OVERLAYS, ignore_errors=True)
    for name in names:
        os.replace(stage / name, folder / name)
