"""Shards: shares of a data set that processes and machines make apart, in folders of their own or in one."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from svbrdfgan.errors import ConfigError
from svbrdfgan.io.atomic import writing
from svbrdfgan.io.claims import claimed

_Item = TypeVar("_Item")

MARKS = "shards"
"""The folder, in that of a data set, with an empty file for each shard that was begun there."""


@dataclass(frozen=True)
class Shard:
    """One of `count` shares, by its `number` from 1 on. Shares of consecutive exemplars bake few meshes twice."""

    number: int
    count: int

    @classmethod
    def parse(cls, text: str) -> Shard:
        """The shard that a text such as "2/4" names.

        Raises:
            ConfigError: the text names none.
        """
        found = re.fullmatch(r"([0-9]{1,9})/([0-9]{1,9})", text)
        if found is None or not 1 <= int(found[1]) <= int(found[2]):
            raise ConfigError(f"--shard {text}: wanted I/N, with I from 1 to N, such as 2/4.")
        return cls(int(found[1]), int(found[2]))

    @classmethod
    def all(cls, count: int) -> list[Shard]:
        """All of so many shards, in order."""
        return [cls(number, count) for number in range(1, count + 1)]

    @classmethod
    def holding(cls, position: int, items: int, count: int) -> Shard:
        """The shard, of so many, whose share of so many items has that of the position, from 0 on."""
        return cls(-(-(position + 1) * count // items), count)

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"

    def of(self, items: Sequence[_Item]) -> Sequence[_Item]:
        """The share of the items. All shares together are the items; their sizes differ by at most one."""
        return items[len(items) * (self.number - 1) // self.count : len(items) * self.number // self.count]


@contextmanager
def gathering(folder: Path) -> Iterator[None]:
    """For the time of the block no other shard gathers the assets of the data set in the folder; waits for its turn.

    Raises:
        AssetError: nothing can be written there.
    """
    marks = folder / MARKS
    with writing(marks):
        marks.mkdir(exist_ok=True)
    try:
        with claimed(marks, f"{folder} is being written by another process", patience=float("inf")):
            yield
    finally:
        with suppress(OSError):  # a shard was begun
            marks.rmdir()


def mark_shard(folder: Path, shard: Shard) -> Path:
    """The file that says that the shard was begun in the folder; who makes the shard claims it.

    Raises:
        ConfigError: the folder holds shards of another number.
        AssetError: nothing can be written there.
    """
    other = shard_counts([folder]) - {shard.count}
    if other:
        raise ConfigError(
            f"{folder} holds shards of {max(other)}, and --shard is {shard}: wanted I/{max(other)}, or another folder."
        )
    mark = folder / MARKS / f"{shard.number}-of-{shard.count}"
    with writing(mark):
        mark.parent.mkdir(exist_ok=True)  # another shard that failed may have removed it
        mark.touch()
    return mark


def shard_counts(folders: Sequence[Path]) -> set[int]:
    """The numbers into which those divided the data set who made shards in the folders."""
    return {int(mark.name.rpartition("-of-")[2]) for folder in folders for mark in (folder / MARKS).glob("*-of-*")}


def remove_marks(folder: Path) -> None:
    """Removes what says that the folder was made by shards.

    Raises:
        AssetError: nothing can be removed there.
    """
    marks = folder / MARKS
    with writing(marks):
        for mark in marks.glob("*-of-*"):
            mark.unlink()
        if marks.is_dir():
            marks.rmdir()
