"""Makes a data set's index: gathers its assets into its folder, before anything is rendered."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from svbrdfgan.config.models import differences
from svbrdfgan.data.config import DatasetConfig, EnvironmentSource, MeshSource, Split, SplitConfig
from svbrdfgan.data.exemplar_files import SplitFiles
from svbrdfgan.data.gather import gather_environments, gather_meshes, match_files
from svbrdfgan.data.index import INDEX, DatasetIndex
from svbrdfgan.data.memory import require_dataset
from svbrdfgan.data.sampler import MeshAsset
from svbrdfgan.data.shards import MARKS
from svbrdfgan.data.trained_model import gather_model, warn_of_new_model
from svbrdfgan.errors import ConfigError
from svbrdfgan.scene.description import AssetRef

_RUN = "config.json"
"""The configuration in a run's folder: `svbrdfgan.training.run.CONFIG`, which this room may not import."""

log = logging.getLogger(__name__)


def make_index(config: DatasetConfig, folder: Path, base: Path, workers: int = 1) -> DatasetIndex:
    """The index of the data set in the folder. If there is none yet, it gathers the assets of all splits and writes it.

    Args:
        base: the folder that file patterns are relative to.
        workers: processes that gather meshes, at most.

    Raises:
        ConfigError: the folder holds a data set of another configuration, a pattern matches nothing, or more memory is
            needed than may be taken.
        AssetError: an asset cannot be read, or the model; or close-ups are wanted of what no camera sees.
    """
    if (folder / _RUN).is_file():
        raise ConfigError(f"{folder} holds a run; choose another folder for the data set.")
    if (folder / INDEX).is_file():
        index = DatasetIndex.load(folder)
        if index.config == config:
            _warn_of_new_files(index, folder, base)
            warn_of_new_model(index.model, config, base)
            return index
        begun = any(SplitFiles(folder, split).numbers for split in index.config.splits)
        if begun or (folder / MARKS).is_dir():  # or other shards may be about to
            changed = "; ".join(differences(index.config.model_dump(), config.model_dump()))
            raise ConfigError(
                f"{folder} holds a data set of another configuration ({changed}); choose another folder or delete it."
            )
        (folder / INDEX).unlink()  # it has no exemplar yet
    files = _match_all(config, base)  # all of them before the first asset is stored
    counts = {split: _mesh_count(source, files[f"splits.{split}.meshes"]) for split, source in config.splits.items()}
    exemplars = sum(count * config.splits[split].views for split, count in counts.items())
    require_dataset(config, exemplars, workers=min(workers, sum(counts.values())))
    meshes = {
        split: gather_meshes(
            source.meshes,
            files[f"splits.{split}.meshes"],
            config,
            folder,
            close_ups=config.camera_of(split).close_ups is not None,
            workers=workers,
        )
        for split, source in config.splits.items()
    }
    environments = {
        split: gather_environments(source, files[key], config.environment_rows, folder)
        for split, (key, source) in _environment_sources(config).items()
    }
    _require_distinct(mesh.asset for pool in meshes.values() for mesh in pool)
    _require_distinct(environment.asset for pool in environments.values() for environment in pool)
    _require_held_out(meshes)
    index = DatasetIndex(
        config=config,
        meshes=meshes,
        environments=environments,
        model=gather_model(config, folder, base),
        parts=_part_ids(meshes) if "parts" in config.labels else {},
    )
    index.save(folder)
    return index


def _mesh_count(source: SplitConfig, files: Sequence[Path]) -> int:
    made = source.meshes.procedural
    return len(files) + (0 if made is None else made.count)


def _part_ids(meshes: Mapping[Split, tuple[MeshAsset, ...]]) -> dict[int, str]:
    """Names of parts by their ids in labels, from 1 on; parts of one name have one id in all meshes. 0 is no part."""
    names = {part for pool in meshes.values() for mesh in pool for part in mesh.parts}
    return dict(enumerate(sorted(names), start=1))


def _environment_sources(config: DatasetConfig) -> dict[Split, tuple[str, EnvironmentSource]]:
    """The source of each split's environments, and the key that declares it."""
    return {
        split: ("environments", config.environments)
        if source.environments is None
        else (f"splits.{split}.environments", source.environments)
        for split, source in config.splits.items()
    }


def _match_all(config: DatasetConfig, base: Path) -> dict[str, list[Path]]:
    """The files of every source that some split uses, by its key.

    Raises:
        ConfigError: a pattern matches nothing; the message opens with its key.
    """
    sources: dict[str, MeshSource | EnvironmentSource] = {
        f"splits.{split}.meshes": source.meshes for split, source in config.splits.items()
    }
    sources |= dict(_environment_sources(config).values())
    files = {}
    for key, source in sources.items():
        try:
            files[key] = match_files(source.files, base)
        except ConfigError as error:
            raise ConfigError(f"{key}.files: {error}") from error
    return files


def _require_distinct(assets: Iterable[AssetRef]) -> None:
    """Refuses different assets of one name: the last would replace the first. Splits may share an asset."""
    first: dict[str, AssetRef] = {}
    for asset in assets:
        if first.setdefault(asset.path, asset) != asset:
            raise ConfigError(
                f"different files of two splits share the name {Path(asset.path).stem!r}; rename one, "
                "since a data set stores assets by name."
            )


def _require_held_out(meshes: Mapping[Split, tuple[MeshAsset, ...]]) -> None:
    """Refuses a data set that would be scored on meshes that it trains on."""
    trained = {mesh.asset.sha256 for mesh in meshes.get("train", ())}
    for split, pool in meshes.items():
        for mesh in pool if split != "train" else ():
            if mesh.asset.sha256 in trained:
                raise ConfigError(
                    f"the mesh {mesh.name!r} is in the splits train and {split}, which would be scored on what it was "
                    "trained on: name other files, or give 'procedural' another seed."
                )


def _warn_of_new_files(index: DatasetIndex, folder: Path, base: Path) -> None:
    """Warns of files that the patterns match now, but did not when the assets were gathered."""
    environments = _environment_sources(index.config)
    for split, source in index.config.splits.items():
        stored = {mesh.name for mesh in index.meshes[split]} | {light.name for light in index.environments[split]}
        for files in (source.meshes.files, environments[split][1].files):
            with suppress(ConfigError):  # the files may be gone, since the folder has copies
                new = sorted({path.stem for path in match_files(files, base)} - stored)
                if new:
                    log.warning(
                        "%s was begun without %s, which %s files match now: choose another folder to have them in.",
                        *(folder, ", ".join(new), split),
                    )
