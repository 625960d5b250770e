"""One split of a data set in memory: its pictures, their scenes, and what they show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from svbrdfgan.data.config import Split
from svbrdfgan.data.generate import exemplar_paths
from svbrdfgan.data.index import DatasetPlan
from svbrdfgan.errors import AssetError
from svbrdfgan.io.exr import load_exr
from svbrdfgan.scene.asset import Subject
from svbrdfgan.scene.description import Scene, SceneWeathering
from svbrdfgan.scene.loader import Studio, subject_key


@dataclass(frozen=True, eq=False)
class Exemplars:
    """The exemplars of a split.

    Attributes:
        images: premultiplied linear radiance, half precision, in memory.
        coverage: share of each pixel that shows the surface, half precision.
        scenes: what made each picture.
        subjects: the surfaces pictured, each once.
        subject_of: for each exemplar, its subject.
        layers: what G0 painted on each exemplar's surface; None where it is not `weathered`. Read when looked at, since
            where every exemplar has its own, they take more memory than the pictures.
    """

    images: Float[Tensor, "exemplars height width 3"]
    coverage: Float[Tensor, "exemplars height width"]
    scenes: tuple[Scene, ...]
    subjects: tuple[Subject, ...]
    subject_of: Int[Tensor, " exemplars"]
    layers: Sequence[Float[Tensor, "rows cols channels"] | None]
    studio: Studio

    def __len__(self) -> int:
        return len(self.scenes)

    def subject(self, exemplar: int) -> Subject:
        return self.subjects[int(self.subject_of[exemplar])]

    def weathered(self, exemplar: int) -> bool:
        """Whether it is known what G0 painted on it."""
        return isinstance(self.scenes[exemplar].weathering, SceneWeathering)

    def views_of(self, subject: int) -> list[int]:
        """The exemplars that show a subject."""
        return torch.nonzero(self.subject_of == subject).flatten().tolist()


def load_exemplars(folder: Path, split: Split) -> Exemplars:
    """Reads a split.

    Raises:
        AssetError: the data set has no such split, is not finished, or a file of it is damaged.
    """
    plan = DatasetPlan.load(folder)
    if split not in plan.config.splits:
        raise AssetError(f"{folder} has no split {split!r}; it has {', '.join(plan.config.splits)}.")
    count = len(plan.sampler(split))
    paths = [exemplar_paths(folder, split, index) for index in range(count)]
    absent = sum(not record.is_file() for _, record in paths)
    if absent:
        raise AssetError(
            f"{folder} is not finished: {absent} of {count} {split} exemplars are missing; run `svbrdfgan dataset`."
        )
    scenes = tuple(Scene.load(record) for _, record in paths)
    pictures = torch.stack([load_picture(picture) for picture, _ in paths])
    studio = Studio(folder)
    keys = [subject_key(scene) for scene in scenes]
    first = {key: keys.index(key) for key in keys}
    number = {key: n for n, key in enumerate(first)}
    return Exemplars(
        images=pictures[..., :3],
        coverage=pictures[..., 3],
        scenes=scenes,
        subjects=tuple(studio.subject(scenes[index]) for index in first.values()),
        subject_of=torch.tensor([number[key] for key in keys]),
        layers=_StoredLayers(studio, scenes),
        studio=studio,
    )


class _StoredLayers(Sequence[Any]):
    def __init__(self, studio: Studio, scenes: Sequence[Scene]) -> None:
        self._studio, self._scenes = studio, scenes

    def __len__(self) -> int:
        return len(self._scenes)

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return _StoredLayers(self._studio, self._scenes[index])
        return self._studio.layer(self._scenes[index])


def load_picture(path: Path) -> Float[Tensor, "height width 4"]:
    """An exemplar's picture as stored: premultiplied RGB and coverage, half precision."""
    channels = load_exr(path)
    try:
        return torch.stack([channels[name] for name in "RGBA"], dim=-1).half()
    except KeyError as error:
        raise AssetError(f"{path} has no channel {error}; it is not an exemplar's picture.") from error
