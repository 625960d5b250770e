"""Photographs the scenes of a data set, and writes what somebody would have who took them: pictures and a manifest."""

from __future__ import annotations

import math
import os
import shutil
import zlib
from collections.abc import Iterator, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch
import yaml

from svbrdfgan.config.models import StrictModel, differences
from svbrdfgan.data.config import ELEVATION, SharedConfig
from svbrdfgan.data.gather import gather_environments, match_files
from svbrdfgan.data.index import DatasetIndex
from svbrdfgan.data.make_index import make_index
from svbrdfgan.data.sampler import clamped
from svbrdfgan.data.staged_photos.config import (
    CAMERA_ERROR,
    F_NUMBER,
    FLASH,
    RAW,
    SHARE,
    Photography,
    StagedPhotosConfig,
)
from svbrdfgan.data.staged_photos.cycles import Second, Shot, find_blender, take
from svbrdfgan.data.trained_model import with_model
from svbrdfgan.errors import ConfigError
from svbrdfgan.geometry.camera_hits import camera_hits
from svbrdfgan.io.atomic import atomic_path, folder_beside
from svbrdfgan.io.claims import claimed_folder
from svbrdfgan.io.image import save_image
from svbrdfgan.io.records import load_record, save_record
from svbrdfgan.plugins.registry import load_embedding
from svbrdfgan.scene.description import OrbitCamera, Scene
from svbrdfgan.scene.embedded_files import save_materials
from svbrdfgan.scene.loader import SceneLoader
from svbrdfgan.utils.display import Display, SilentDisplay
from svbrdfgan.utils.processes import cores, worker_pool

MANIFEST = "manifest.yaml"
TRUTH = "truth"
"""The folder of what whoever imports the photographs must not know: a data set of the same scenes."""
_RECORD = "photography.json"
_PARTS = 4
"""Parts, for each of several processes, that the work is cut into at least."""
_GROUND = ((0.05, 0.05, 0.05), (0.18, 0.17, 0.16), (0.3, 0.27, 0.22), (0.08, 0.12, 0.05))
"""Linear reflectances of asphalt, concrete, sand and grass."""


class StagedPhoto(StrictModel):
    """The truth of one photograph, next to the scene that it shows.

    Attributes:
        claimed: the camera in the manifest.
        gain: the camera's factor on each channel of radiance, besides its exposure.
        masked: whether the manifest has a mask.
        flash: that is beside the camera for the second picture; None without one.
    """

    scene: Scene
    claimed: OrbitCamera
    view: str
    exposure_stops: float
    gain: tuple[float, float, float]
    f_number: float
    noise: float
    jpeg_quality: int
    ground: tuple[float, float, float] | None
    masked: bool
    flash: float | None = None

    @property
    def suffix(self) -> str:
        """Of its file."""
        return ".exr" if self.view == RAW else ".jpg"


def stage_photos(
    config: StagedPhotosConfig,
    folder: Path,
    *,
    base: Path,
    blender: str | None = None,
    jobs: int = 1,
    display: Display | None = None,
) -> Path:
    """Photographs what is missing of the scenes of `train`, and returns the manifest, which is written last.

    `photos`, `masks`, `meshes` and `pool` are what a photographer has; `truth` is the data set of the same scenes, all
    splits, which `generate` can render, with the truth of each photograph beside.

    Args:
        base: the folder that file patterns of the configuration are relative to.
        blender: as for `find_blender`.
        jobs: Blenders at a time, which share the cores. More than one are started by spawned processes, so a script
            that asks for them needs its `if __name__ == "__main__"`.

    Raises:
        ConfigError: the folder holds other photographs, a pattern matches nothing, or there is no Blender.
        AssetError: an asset cannot be read, or Blender failed.
    """
    shown, program = display or SilentDisplay(), find_blender(blender)
    load_embedding(config.embedding.name, config.embedding.options)
    with claimed_folder(folder):
        truth = folder / TRUTH
        _require_same(config.photography, truth / _RECORD)
        index = make_index(with_model(config.dataset, truth, base), truth, base)
        save_record(truth / _RECORD, config.photography)
        stage = _Stage(config, folder, index, max(1, cores() // jobs) if jobs > 1 else None)
        photos = stage.photos()
        taken_before = sum(stage.photo(number, photo).is_file() for number, photo in enumerate(photos))
        shown.begin("photographs", len(photos), taken_before)
        for taken in stage.take_missing(photos, program, jobs):
            shown.advance(taken)
        return stage.write_manifest(photos, base)


@dataclass(frozen=True, eq=False)
class _Stage:
    """What decides of all photographs.

    Attributes:
        threads: for each Blender; None for one on each core.
    """

    config: StagedPhotosConfig
    folder: Path
    index: DatasetIndex
    threads: int | None

    @cached_property
    def loader(self) -> SceneLoader:
        """Of the truth; caches nothing in files, since that would take ten times the space of all pictures."""
        return SceneLoader(self.folder / TRUTH, keep=False)

    def photos(self) -> list[StagedPhoto]:
        """All photographs."""
        return [self.draw(number) for number in range(len(self.index.sampler("train")))]

    def take_missing(self, photos: Sequence[StagedPhoto], program: Sequence[str], jobs: int) -> Iterator[int]:
        """Takes the photographs that are not there; yields how many more are.

        Raises:
            AssetError: an asset cannot be read, Blender failed, or a process was killed.
        """
        missing = [
            [number for number in numbers if not self.photo(number, photos[number]).is_file()]
            for numbers in _by_mesh(photos)
        ]
        total = sum(map(len, missing))
        size = max(1, total // (_PARTS * jobs) if jobs > 1 else total)
        groups = [group[n : n + size] for group in missing for n in range(0, len(group), size)]
        if jobs == 1 or len(groups) < 2:
            for group in groups:
                for _ in self.take(group, [photos[number] for number in group], program):
                    yield 1
                self.loader.forget()
            return
        bare = replace(self)  # without the loader, which processes do not share
        with worker_pool(min(jobs, len(groups)), "photographs", "--jobs") as pool:
            tasks = [
                pool.submit(_take_all, bare, group, [photos[number] for number in group], program) for group in groups
            ]
            for task in as_completed(tasks):
                yield task.result()

    def photo(self, number: int, photo: StagedPhoto) -> Path:
        return self.folder / "photos" / f"{number:06d}{photo.suffix}"

    def second(self, number: int, photo: StagedPhoto) -> Path:
        """The other picture of a pair."""
        return self.folder / "photos" / f"{number:06d}-{self.config.photography.pairs}{photo.suffix}"

    def mask(self, number: int) -> Path:
        return self.folder / "masks" / f"{number:06d}.png"

    def draw(self, number: int) -> StagedPhoto:
        """The photograph of a scene, which depends on seed and number alone."""
        scene, said = self.index.sampler("train").scene(number), self.config.photography
        rng = np.random.default_rng([self.config.seed, zlib.crc32(b"photograph"), number])
        off = [said.camera_error_degrees.sample(rng) for _ in range(2)]
        claimed = scene.camera.model_copy(
            update={
                "azimuth_degrees": (scene.camera.azimuth_degrees + off[0]) % 360.0,
                "elevation_degrees": clamped(scene.camera.elevation_degrees + off[1], ELEVATION),
                "distance": scene.camera.distance * (1.0 + clamped(said.camera_error.sample(rng), CAMERA_ERROR)),
            }
        )
        return StagedPhoto(
            scene=scene,
            claimed=claimed,
            view=said.view.sample(rng),
            exposure_stops=said.exposure_stops.sample(rng),
            gain=self._gain(scene, clamped(said.white_balance.sample(rng), SHARE)),
            f_number=clamped(said.f_number.sample(rng), F_NUMBER),
            noise=clamped(said.noise.sample(rng), SHARE),
            jpeg_quality=said.jpeg_quality.sample(rng),
            ground=_GROUND[int(rng.integers(len(_GROUND)))] if said.ground else None,
            masked=bool(rng.random() < said.masks),
            flash=clamped(said.flash.sample(rng), FLASH) if said.pairs == "flash" else None,
        )

    def take(self, numbers: Sequence[int], photos: Sequence[StagedPhoto], program: Sequence[str]) -> Iterator[int]:
        """Photographs of one mesh, each of which appears whole, after its mask and its truth; yields their numbers."""
        (self.folder / "photos").mkdir(parents=True, exist_ok=True)
        with folder_beside(self.folder / "taking") as place:
            shots = [self._shot(photo, place, number) for number, photo in zip(numbers, photos, strict=True)]
            for done in take(shots, program):
                number, photo = numbers[done], photos[done]
                save_record(self.folder / TRUTH / "photos" / f"{number:06d}.json", photo)
                if photo.masked:
                    self._save_mask(photo.scene, self.mask(number))
                if (second := shots[done].second) is not None:
                    os.replace(second.photo, self.second(number, photo))
                os.replace(shots[done].photo, self.photo(number, photo))
                yield number

    def write_manifest(self, photos: Sequence[StagedPhoto], base: Path) -> Path:
        """What a photographer writes down, and the files that it names."""
        meshes, pool = self.folder / "meshes", self.config.photography.pool
        meshes.mkdir(exist_ok=True)
        for asset in {photo.scene.mesh.path for photo in photos}:
            shutil.copyfile(self.loader.folder / asset, meshes / Path(asset).name)
        files = match_files(pool.files, base)
        gather_environments(pool, files, self.config.environment_rows, self.folder / "pool")
        written: dict[str, Any] = {
            "pictures": [self._entry(number, photo) for number, photo in enumerate(photos)],
            **self.config.model_dump(mode="json", include=set(SharedConfig.model_fields)),
            "environments": {"files": ["pool/assets/environments/*"]},
        }
        with atomic_path(self.folder / MANIFEST) as temporary:
            temporary.write_text(yaml.safe_dump(written, sort_keys=False), encoding="utf-8")
        return self.folder / MANIFEST

    def _entry(self, number: int, photo: StagedPhoto) -> dict[str, Any]:
        file, pairs = self.photo(number, photo), self.config.photography.pairs
        entry: dict[str, Any] = {
            "file": str((self.second(number, photo) if pairs == "flash" else file).relative_to(self.folder)),
            "mesh": f"meshes/{Path(photo.scene.mesh.path).name}",
            "camera": photo.claimed.model_dump(mode="json"),
        }
        if pairs == "before":
            entry["before"] = str(self.second(number, photo).relative_to(self.folder))
        if photo.flash is not None:
            entry["without_flash"] = str(file.relative_to(self.folder))
            if photo.view == RAW:  # what white paper at a metre would have been measured to be
                entry["flash"] = [photo.flash * gain * photo.scene.camera.distance**2 for gain in photo.gain]
        if photo.masked:
            entry["mask"] = str(self.mask(number).relative_to(self.folder))
        if photo.scene.materials:
            entry["paint"] = list(next(iter(photo.scene.materials.values())))
        return entry

    def _shot(self, photo: StagedPhoto, place: Path, number: int) -> Shot:
        scene, said = photo.scene, self.config.photography
        subject, camera = self.loader.subject(scene), scene.camera.camera()
        mesh = place / f"{number}.glb"
        layer = self.loader.layer(scene)
        save_materials(mesh, subject, subject.materials(layer, scene.maps, base_colors=scene.materials))
        clean, second = place / f"{number}-clean.glb", None
        if said.pairs is not None:
            second = Second(str(place / f"{number}-second{photo.suffix}"), flash=photo.flash)
        if said.pairs == "before" and second is not None:
            second = replace(second, mesh=str(clean))
            assert layer is not None  # staged photographs show weathering
            transparent = replace(layer, values=torch.zeros_like(layer.values))
            save_materials(clean, subject, subject.materials(transparent, scene.maps, base_colors=scene.materials))
        return Shot(
            photo=str(place / f"{number}{photo.suffix}"),
            mesh=str(mesh),
            environment=str(self.loader.file(scene.environment.asset).resolve()),
            rotation=math.radians(scene.environment.rotation_degrees),
            scale=scene.environment.scale,
            origin=camera.origin,
            target=camera.target,
            vertical_fov=camera.vertical_fov,
            width=scene.width,
            height=scene.height,
            samples=said.samples,
            bounces=said.bounces,
            seed=scene.seed,
            background=said.background,
            f_number=photo.f_number,
            ground=photo.ground,
            gain=photo.gain,
            exposure_stops=photo.exposure_stops,
            view=None if photo.view == RAW else photo.view,
            noise=photo.noise,
            jpeg_quality=photo.jpeg_quality,
            threads=self.threads,
            second=second,
        )

    def _gain(self, scene: Scene, share: float) -> tuple[float, float, float]:
        """What takes that share of the mean light's colour out of the picture, and leaves green."""
        mean = self.loader.view(scene).environment.radiance.mean(dim=(0, 1))
        red, green, blue = ((mean[1] / mean.clamp(min=1e-6)) ** share).tolist()
        return red, green, blue

    def _save_mask(self, scene: Scene, path: Path) -> None:
        """The silhouette that a pinhole in the true camera's place sees."""
        surface = self.loader.subject(scene).surface
        hits = camera_hits(surface, scene.camera.camera(), scene.width, scene.height)
        path.parent.mkdir(exist_ok=True)
        save_image(path, torch.from_numpy(hits.hit).float().unsqueeze(-1))


def _take_all(stage: _Stage, numbers: Sequence[int], photos: Sequence[StagedPhoto], program: Sequence[str]) -> int:
    """Takes photographs in a worker process; returns how many."""
    return len(list(stage.take(numbers, photos, program)))


def _by_mesh(photos: Sequence[StagedPhoto]) -> list[list[int]]:
    groups: dict[str, list[int]] = {}
    for number, photo in enumerate(photos):
        groups.setdefault(photo.scene.mesh.path, []).append(number)
    return list(groups.values())


def _require_same(photography: Photography, record: Path) -> None:
    if not record.is_file():
        return
    known = load_record(Photography, record)
    if changed := differences(known.model_dump(), photography.model_dump()):
        raise ConfigError(
            f"{record.parent.parent} holds photographs that were taken otherwise (photography: {'; '.join(changed)}); "
            "choose another folder or delete it."
        )
