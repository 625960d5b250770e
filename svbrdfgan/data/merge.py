"""Merges shards: checks that a data set is whole, and leaves no trace of who made which of its exemplars."""

from __future__ import annotations

import logging
import os
import shutil
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from itertools import chain, groupby
from pathlib import Path

from svbrdfgan.config.models import differences
from svbrdfgan.data.config import Split
from svbrdfgan.data.exemplar_files import SplitFiles, pack_path, packing
from svbrdfgan.data.index import INDEX, DatasetIndex
from svbrdfgan.data.labels import label_paths
from svbrdfgan.data.shards import Shard, remove_marks, shard_counts
from svbrdfgan.errors import AssetError, ConfigError
from svbrdfgan.io.atomic import folder_beside
from svbrdfgan.io.claims import claimed
from svbrdfgan.scene.description import Scene
from svbrdfgan.scene.loader import SceneLoader
from svbrdfgan.utils.display import Display, SilentDisplay
from svbrdfgan.utils.leftovers import remove_leftovers

log = logging.getLogger(__name__)

_Exemplar = tuple[Split, int]

_TOLD = 6
"""Shards that a message lists."""


def merge_shards(
    folders: Sequence[Path], out: Path | None = None, *, packed: bool = False, display: Display | None = None
) -> DatasetIndex:
    """Makes one data set of shards: the same files as if one machine had made the whole, caches aside.

    Args:
        folders: one into which all shards were written, or several.
        out: where a copy of all is written; None completes the one folder in place.
        packed: the exemplars are packed into tar files, instead of several small files for each.

    Raises:
        ConfigError: several folders and no `out`, one that exists, or folders of different data sets.
        AssetError: a folder is no data set, files are missing or damaged, or a process is still writing there.
    """
    display, folders = display or SilentDisplay(), list(dict.fromkeys(folders))
    if out is None and len(folders) > 1:
        raise ConfigError("several folders are joined into another one: name it by -o.")
    if out is not None and out.exists():
        raise ConfigError(f"{out} already exists; choose another folder to join the shards in.")
    with ExitStack() as stack:
        for folder in folders:
            stack.enter_context(claimed(folder, f"{folder} is being written by another process"))
        index = _common_index(folders)
        stored = {split: [SplitFiles(folder, split) for folder in folders] for split in index.config.splits}
        for files in chain(*stored.values()):
            stack.enter_context(files)
        makers = _makers(index, folders, stored)
        _check(index, makers, folders[0], display)
        if out is None:
            if packed:
                _pack(index, makers, folders[0], display)
                for split in index.config.splits:
                    SplitFiles(folders[0], split).remove_loose()
            _tidy(folders[0], index)
            return index
        with folder_beside(out) as stage:
            _copy_assets(folders, stage)
            (_pack if packed else _copy)(index, makers, stage, display)
            shutil.copyfile(folders[0] / INDEX, stage / INDEX)
            os.rename(stage, out)
        return index


def _common_index(folders: Sequence[Path]) -> DatasetIndex:
    first, *others = map(DatasetIndex.load, folders)
    if first.config.weathering is None:
        raise ConfigError(f"{folders[0]} holds imported pictures, which are never made by shards.")
    for folder, index in zip(folders[1:], others, strict=True):
        changed = "; ".join(differences(first.config.model_dump(), index.config.model_dump()))
        if changed:
            raise ConfigError(f"{folders[0]} and {folder} are of different configurations ({changed}); merge others.")
        if index != first:
            raise ConfigError(
                f"{folders[0]} and {folder} are of one configuration, but their meshes, environments or models differ: "
                "make one of them again from the same files and versions."
            )
    return first


def _makers(
    index: DatasetIndex, folders: Sequence[Path], stored: Mapping[Split, Sequence[SplitFiles]]
) -> dict[_Exemplar, SplitFiles]:
    """The files, of those stored in the folders, that first have each exemplar.

    Raises:
        AssetError: none has one of them; the message names the shards that are missing.
    """
    exemplars, makers = index.exemplars(), dict[_Exemplar, SplitFiles]()
    there = {split: [files.numbers for files in each] for split, each in stored.items()}
    for split, number in exemplars:
        for files, numbers in zip(stored[split], there[split], strict=True):
            if number in numbers:
                makers[split, number] = files
                break
    if len(makers) < len(exemplars):
        where = " and ".join(map(str, folders)) + (" lacks" if len(folders) == 1 else " lack")
        lacking = f"{where} {len(exemplars) - len(makers)} of {len(exemplars)} exemplars"
        counts = shard_counts(folders)
        if len(counts) != 1:
            raise AssetError(f"{lacking}: `svbrdfgan dataset CONFIG -o {folders[0]}` makes them.")
        count, places = counts.pop(), [place for place, each in enumerate(exemplars) if each not in makers]
        absent = list(dict.fromkeys(Shard.holding(place, len(exemplars), count) for place in places))
        named = ", ".join(map(str, absent[:_TOLD])) + (f" and {len(absent) - _TOLD} more" if absent[_TOLD:] else "")
        raise AssetError(
            f"{lacking}, of the shards {named}: make them, such as by `svbrdfgan dataset CONFIG -o {folders[0]} "
            f"--shard {absent[0]}`, and merge again."
        )
    return makers


def _check(index: DatasetIndex, makers: dict[_Exemplar, SplitFiles], assets: Path, display: Display) -> None:
    """Checks that each scene is that of the index, with its files beside it, and that the assets are.

    Raises:
        AssetError: something is missing or damaged.
    """
    loader = SceneLoader(assets, keep=False)
    lights = [light.asset for pool in index.environments.values() for light in pool]
    model = [] if index.model is None else [index.model.asset]
    for asset in [*(mesh.asset for pool in index.meshes.values() for mesh in pool), *lights, *model]:
        loader.file(asset)
    display.begin("checking the exemplars", len(makers))
    samplers, renderers = {split: index.sampler(split) for split in index.config.splits}, set[str]()
    for (split, number), made in makers.items():
        wanted = samplers[split].scene(number)
        with made.exemplar(number) as paths:
            *files, record = _files(index, *paths)
            for file in files:
                if not file.is_file():
                    raise AssetError(f"{file} is missing: delete {record}, make the shard again, and merge.")
            scene = Scene.load(record)
            if scene.model_copy(update={"renderer": wanted.renderer}) != wanted:
                raise AssetError(
                    f"{record} is not the scene of that number: delete it, make the shard again, and merge."
                )
        renderers.add(scene.renderer.name)
        display.advance()
    if len(renderers) > 1:
        named = ", ".join(sorted(renderers))
        log.warning("the exemplars are by several renderers (%s): better name one in `renderer`", named)


def _files(index: DatasetIndex, picture: Path, record: Path) -> list[Path]:
    """The files of an exemplar, beside the two; its scene is the last."""
    return [picture, *label_paths(picture, index.config.labels), record]


def _tidy(folder: Path, index: DatasetIndex) -> None:
    """Removes what shards left, those of other machines, too: nobody else writes there."""
    for place in (folder, *(folder / "assets").glob("**/"), *(folder / split for split in index.config.splits)):
        remove_leftovers(place, of_all_machines=True)
    remove_marks(folder)


def _copy_assets(folders: Sequence[Path], stage: Path) -> None:
    hidden = shutil.ignore_patterns(".*")
    shutil.copytree(folders[0] / "assets", stage / "assets", ignore=hidden)
    for folder in folders:  # baked once, whoever needs it next
        if (folder / "cache").is_dir():
            shutil.copytree(folder / "cache", stage / "cache", ignore=hidden, dirs_exist_ok=True)


def _copy(index: DatasetIndex, makers: dict[_Exemplar, SplitFiles], stage: Path, display: Display) -> None:
    display.begin("copying the exemplars", len(makers))
    for (split, number), made in makers.items():
        (stage / split).mkdir(exist_ok=True)
        with made.exemplar(number) as paths:
            for file in _files(index, *paths):
                shutil.copyfile(file, stage / split / file.name)
        display.advance()


def _pack(index: DatasetIndex, makers: dict[_Exemplar, SplitFiles], folder: Path, display: Display) -> None:
    """Writes the tar files of all exemplars into a folder."""
    display.begin("packing the exemplars", len(makers))
    for path, group in groupby(makers, lambda exemplar: pack_path(folder, *exemplar)):
        with packing(path) as add:
            for split, number in group:
                with makers[split, number].exemplar(number) as paths:
                    for file in _files(index, *paths):
                        add(file)
                display.advance()
