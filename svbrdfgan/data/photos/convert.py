"""Converts checked pictures to a data set of exemplars, each with its scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from svbrdfgan.data.config import Split
from svbrdfgan.data.exemplar_files import exemplar_paths, save_exemplar
from svbrdfgan.data.gather import mesh_asset
from svbrdfgan.data.index import DatasetIndex
from svbrdfgan.data.photos.check import ImportJob, RectifiedPhoto
from svbrdfgan.data.photos.converter import Converter, EstimatedLight
from svbrdfgan.data.photos.crew import Crew, crew, unwrap
from svbrdfgan.data.photos.light import Evidence
from svbrdfgan.data.photos.manifest import Manifest
from svbrdfgan.data.reflectance_errors import errors_path, mean_error, save_errors
from svbrdfgan.data.sampler import EnvironmentAsset, MeshAsset
from svbrdfgan.data.trained_model import TrainedModel
from svbrdfgan.types import Mesh

Place = tuple[Split, int]
"""Where an exemplar lies in its data set."""


@dataclass(frozen=True)
class Imported:
    """What the import of a picture found.

    Attributes:
        exposure: the factor on the picture's linear values.
        uncertainty: by how much its reflectance is off, to judge by imports of simulated pictures: the mean absolute
            logarithm of found over true; None if none were simulated.
    """

    exposure: float
    uncertainty: float | None


_MOST_EVIDENCE = 40_000
"""Pixels, about, that the light of a group is estimated from."""
_LEAST_EVIDENCE = 100
"""The same, of each of its pictures."""


def places(manifest: Manifest) -> list[Place]:
    """The place of each picture in the data set. Views of one mesh follow each other, as training requires."""
    found: dict[int, Place] = {}
    for split in manifest.config().splits:
        chosen = [n for mesh in manifest.meshes(split) for n, e in enumerate(manifest.pictures) if e.mesh == mesh]
        found |= {number: (split, index) for index, number in enumerate(chosen)}
    return [found[number] for number in range(len(manifest.pictures))]


def convert_photos(
    job: ImportJob,
    meshes: Mapping[str, Mesh],
    pool: tuple[EnvironmentAsset, ...],
    photos: Sequence[RectifiedPhoto],
    folder: Path,
    model: TrainedModel | None = None,
    workers: int | None = 1,
) -> dict[int, Imported]:
    """Writes the data set, and returns what was found of each picture in it; the job notes why others are missing.

    Args:
        model: says which weathering the pictures are expected to show.
        workers: processes that share the pictures, as for `crew`.

    Raises:
        ConfigError: no picture can be used.
        AssetError: an asset cannot be read, or a process was killed.
    """
    index = _index(job.manifest, meshes, pool, folder)
    imported: dict[int, Imported] = {}
    at = places(job.manifest)
    order = sorted(range(len(photos)), key=at.__getitem__)  # a mesh is prepared once
    with crew(workers, job.manifest, job.base, index, folder, model) as converters:
        shared = _shared_lights(job, converters, photos, order)
        usable = [number for number in order if number not in job.unusable]
        job.display.begin("exemplars", len(usable))
        wanted = [(photos[number], number, shared.get(number), at[number]) for number in usable]
        for number, made in zip(usable, converters.map(_convert, wanted, job.display), strict=True):
            with job.picture(number):
                imported[number] = unwrap(made)
    job.require_some(imported)
    kept = job.manifest.keeping(imported)
    if len(imported) < len(photos):
        _close_ranks([at[number] for number in sorted(imported)], places(kept), folder)
        index = _index(kept, meshes, pool, folder)
    index.save(folder)
    return imported


def _convert(converter: Converter, wanted: tuple[RectifiedPhoto, int, EstimatedLight | None, Place]) -> Imported:
    """Writes an exemplar, and returns what was found of its picture."""
    photo, number, shared, place = wanted
    converted, folder = converter.convert(photo, number, shared), converter.loader.folder
    picture, record = exemplar_paths(folder, *place)
    save_exemplar(picture, converted.picture)
    converted.scene.save(record)
    if converted.errors is not None:
        save_errors(errors_path(folder, *place), converted.errors)
    return Imported(converted.exposure, None if converted.errors is None else mean_error(converted.errors))


def _thinned(converter: Converter, wanted: tuple[RectifiedPhoto, int, int]) -> Evidence:
    """What a picture says of its light, in at most so many pixels."""
    photo, number, most = wanted
    return converter.evidence(photo, number).thinned(most)


def _close_ranks(before: Sequence[Place], after: Sequence[Place], folder: Path) -> None:
    """Renames the files of exemplars where others before them are missing, in order, so that no name is taken."""
    for old, new in sorted(zip(before, after, strict=True)):
        for path, wanted in zip(_files(folder, old), _files(folder, new), strict=True):
            if path.is_file():
                path.rename(wanted)


def _files(folder: Path, place: Place) -> tuple[Path, ...]:
    return (*exemplar_paths(folder, *place), errors_path(folder, *place))


def _shared_lights(
    job: ImportJob, converters: Crew, photos: Sequence[RectifiedPhoto], order: Sequence[int]
) -> dict[int, EstimatedLight]:
    """The light of each picture of a group, by number. Pictures that say too little are reported, and left out."""
    groups: dict[str, list[int]] = {}
    for number in order:
        if (name := photos[number].entry.light_group) is not None:
            groups.setdefault(name, []).append(number)
    if groups:
        job.display.begin("light of groups", sum(map(len, groups.values())))
    lights: dict[int, EstimatedLight] = {}
    for group, members in enumerate(groups.values()):
        found: dict[int, Evidence] = {}
        most = max(_LEAST_EVIDENCE, _MOST_EVIDENCE // len(members))
        wanted = [(photos[number], number, most) for number in members]
        for number, evidence in zip(members, converters.map(_thinned, wanted, job.display), strict=True):
            with job.picture(number):
                found[number] = unwrap(evidence)
        if found:
            estimated = converters.first.light(f"light of group {group}", list(found.values()))
            lights |= dict(zip(found, estimated, strict=True))
    return lights


def _index(
    manifest: Manifest, meshes: Mapping[str, Mesh], pool: tuple[EnvironmentAsset, ...], folder: Path
) -> DatasetIndex:
    config = manifest.config()
    views = [entry.mesh for entry in manifest.pictures]

    def asset(file: str) -> MeshAsset:
        stored = mesh_asset(Path(file).stem, meshes[file], config, folder)
        return stored.model_copy(update={"views": views.count(file)})

    assets = {split: tuple(asset(file) for file in manifest.meshes(split)) for split in config.splits}
    return DatasetIndex(config=config, meshes=assets, environments=dict.fromkeys(config.splits, pool))
