"""A data set's index, `dataset.json`: its configuration and its assets, gathered into its folder before rendering."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pydantic import model_validator

from svbrdfgan.config.models import StrictModel, validate
from svbrdfgan.data.config import DatasetConfig, Split
from svbrdfgan.data.sampler import ConfigSampler, EnvironmentAsset, MeshAsset
from svbrdfgan.errors import AssetError
from svbrdfgan.io.records import load_json, save_record
from svbrdfgan.scene.description import SceneModel

INDEX = "dataset.json"
FORMAT = "svbrdfgan data set 1"


class DatasetIndex(StrictModel):
    """The contents of `dataset.json`.

    `model` is the one that paints the layers, if a model does. `parts` names the part ids of the data set's labels.
    """

    format: str = FORMAT
    config: DatasetConfig
    meshes: dict[Split, tuple[MeshAsset, ...]]
    environments: dict[Split, tuple[EnvironmentAsset, ...]]
    model: SceneModel | None = None
    parts: dict[int, str] = {}

    @model_validator(mode="after")
    def _serves_its_splits(self) -> DatasetIndex:
        for split in self.config.splits:
            if not self.meshes.get(split) or not self.environments.get(split):
                raise ValueError(f"it names no meshes or no environments of the split {split!r}")
        named = {*self.parts.values()} if "parts" in self.config.labels else None
        for mesh in (mesh for pool in self.meshes.values() for mesh in pool):
            if named is not None and not named.issuperset(mesh.parts):
                raise ValueError(f"parts gives no id to {sorted({*mesh.parts} - named)[0]!r} of the mesh {mesh.name!r}")
        return self

    def sampler(self, split: Split) -> ConfigSampler:
        """Draws the scenes of a split."""
        return ConfigSampler(self.config, split, self.meshes[split], self.environments[split], self.model)

    def exemplars(self) -> list[tuple[Split, int]]:
        """Split and number of each exemplar; those of a mesh in a split follow each other."""
        return [(split, number) for split in self.config.splits for number in range(len(self.sampler(split)))]

    def save(self, folder: Path) -> None:
        save_record(folder / INDEX, self)

    @classmethod
    def load(cls, folder: Path) -> DatasetIndex:
        """Reads the index of the data set in a folder.

        Raises:
            AssetError: the folder is no data set, or one of another version.
        """
        path = folder / INDEX
        if not path.is_file():
            raise AssetError(f"{folder} is not a data set: it has no {INDEX}; make one with `svbrdfgan dataset`.")
        data = load_json(path)
        if not isinstance(data, dict) or data.get("format") != FORMAT:
            raise AssetError(f"{path} is not of this version ({FORMAT!r}); make the data set again.")
        return validate(cls, data, str(path))


@dataclass(frozen=True, eq=False)
class Dataset:
    """A data set that was opened: its folder and its index, read once."""

    folder: Path
    index: DatasetIndex

    @classmethod
    def open(cls, folder: Path) -> Dataset:
        """The data set in a folder.

        Raises:
            AssetError: the folder is no data set, or one of another version.
        """
        return cls(folder, DatasetIndex.load(folder))

    @property
    def config(self) -> DatasetConfig:
        return self.index.config
