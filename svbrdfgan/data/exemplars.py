"""A split of a data set in memory: pictures, their scenes, and what they show."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from svbrdfgan.data.config import DatasetConfig, Split
from svbrdfgan.data.exemplar_files import SplitFiles, load_picture
from svbrdfgan.data.index import Dataset
from svbrdfgan.errors import AssetError
from svbrdfgan.networks.saved import GeneratorConfig
from svbrdfgan.scene.description import Scene, SceneWeathering
from svbrdfgan.scene.loader import SceneLoader, subject_key
from svbrdfgan.scene.subject import Subject
from svbrdfgan.types import Layer
from svbrdfgan.utils.large_tensors import half_tensor


@dataclass(frozen=True, eq=False)
class Exemplars:
    """The exemplars of a split.

    Attributes:
        images: premultiplied linear radiance, half precision, in main memory or, if there are many, in a file.
        coverage: share of each pixel that shows the surface, half precision.
        scenes: the description of each picture's scene.
        subjects: the surfaces that the pictures show, each once. A window is read from its file when it is asked for.
        subject_of: for each exemplar, the index of its subject.
        layers: what G0 painted on each exemplar's surface; None where it is not `weathered`. A layer is read from its
            file when it is asked for: together they may take more memory than the pictures.
        loader: loads what the scenes name.
    """

    images: Float[Tensor, "exemplars height width 3"]
    coverage: Float[Tensor, "exemplars height width"]
    scenes: tuple[Scene, ...]
    subjects: Sequence[Subject]
    subject_of: Int[Tensor, " exemplars"]
    layers: Sequence[Layer | None]
    loader: SceneLoader

    def __len__(self) -> int:
        return len(self.scenes)

    @property
    def windowed(self) -> bool:
        """Whether all subjects are windows; training sees windows alone, or none."""
        return _windowed(self.scenes)

    def subject(self, exemplar: int) -> Subject:
        return self.subjects[int(self.subject_of[exemplar])]

    def weathered(self, exemplar: int) -> bool:
        """Whether the exemplar's layer, which G0 painted, is known."""
        return isinstance(self.scenes[exemplar].weathering, SceneWeathering)

    def views_of(self, subject: int) -> list[int]:
        """The exemplars that show a subject."""
        return torch.nonzero(self.subject_of == subject).flatten().tolist()


def load_exemplars(dataset: Dataset, split: Split, generator: GeneratorConfig | None = None) -> Exemplars:
    """Reads a split of a data set into memory.

    Args:
        generator: the subjects have what it reads.

    Raises:
        AssetError: the data set has no such split, is not finished, or a file of it is damaged.
    """
    folder, index = dataset.folder, dataset.index
    if split not in index.config.splits:
        raise AssetError(f"{folder} has no split {split!r}; it has {', '.join(index.config.splits)}.")
    count = len(index.sampler(split))
    loader, (width, height), scenes = SceneLoader(folder), index.config.image, []
    with SplitFiles(folder, split) as files:
        absent = count - len(files.numbers.intersection(range(count)))
        if absent:
            raise AssetError(
                f"{folder} is not finished: {absent} of {count} {split} exemplars are missing; run `svbrdfgan dataset`."
            )
        pictures = half_tensor((count, height, width, 4), loader.cache)
        for number in range(count):
            with files.exemplar(number) as (picture, record):
                scenes.append(_load_scene(record, index.config))
                pictures[number] = _load_picture(picture, scenes[number])
    load = partial(_load_subject, loader, GeneratorConfig() if generator is None else generator)
    keys = [subject_key(scene) for scene in scenes]
    first_of = dict(zip(reversed(keys), reversed(scenes), strict=True))
    number_of = {key: number for number, key in enumerate(dict.fromkeys(keys))}
    shown = _Loaded(load, [first_of[key] for key in number_of])
    return Exemplars(
        images=pictures[..., :3],
        coverage=pictures[..., 3],
        scenes=tuple(scenes),
        subjects=shown if _windowed(scenes) else tuple(shown),
        subject_of=torch.tensor([number_of[key] for key in keys]),
        layers=_Loaded(loader.layer, scenes),
        loader=loader,
    )


def _windowed(scenes: Sequence[Scene]) -> bool:
    return all(scene.window is not None for scene in scenes)


def _load_subject(loader: SceneLoader, generator: GeneratorConfig, scene: Scene) -> Subject:
    subject = loader.with_mesh_maps(scene) if generator.mesh_maps else loader.subject(scene)
    if generator.refined is None:
        return subject
    return replace(subject, wholes=loader.wholes(scene, mesh_maps=generator.mesh_maps))


def _load_scene(record: Path, config: DatasetConfig) -> Scene:
    """An exemplar's scene, which has what all scenes of its data set have in common."""
    scene = Scene.load(record)
    wanted = {"width": config.image[0], "height": config.image[1], "texture": config.texture}
    for name, value in wanted.items():
        if (own := getattr(scene, name)) != value:
            raise AssetError(f"{record} has {name} {own}, and its data set {value}; delete it, and make it again.")
    if tuple(scene.maps) != tuple(config.maps):
        raise AssetError(f"{record} has other maps than its data set; delete it, and make it again.")
    return scene


def _load_picture(path: Path, scene: Scene) -> Float[Tensor, "height width 4"]:
    picture = load_picture(path)
    if picture.shape != (scene.height, scene.width, 4):
        raise AssetError(f"{path} has another size than its scene; delete it and its record, and make them again.")
    return picture


class _Loaded(Sequence[Any]):
    """What a function loads of each scene, when it is asked for."""

    def __init__(self, load: Callable[[Scene], Any], scenes: Sequence[Scene]) -> None:
        self._load, self._scenes = load, scenes

    def __len__(self) -> int:
        return len(self._scenes)

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return _Loaded(self._load, self._scenes[index])
        return self._load(self._scenes[index])
