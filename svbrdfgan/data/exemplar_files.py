"""The files of exemplars: a picture, premultiplied linear radiance with coverage, and the scene that it shows.

They are loose, in a folder for each split, or packed into tar files of `PACK` exemplars, which WebDataset reads, too.
"""

from __future__ import annotations

import re
import tarfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.data.config import Split
from svbrdfgan.errors import AssetError, SvbrdfganError
from svbrdfgan.io.atomic import atomic_path, writing
from svbrdfgan.io.exr import load_exr, save_exr
from svbrdfgan.io.files import check_file, parsing
from svbrdfgan.types import Rendering
from svbrdfgan.utils.leftovers import scratch_folder

BRIGHTEST = 60000.0
"""Stored pictures are clamped to this radiance, since half-precision floats end at 65504."""
PACK = 10_000
"""Exemplars of a tar file, consecutive ones of a split."""

_FILE = re.compile(r"([0-9]{6,9})\.(?:exr|json|labels\.exr|weathered\.png|parts\.png)")
_FILES = 5  # of an exemplar, at most
_CHUNK = 1 << 20


def exemplar_paths(folder: Path, split: Split, index: int) -> tuple[Path, Path]:
    """The loose files of an exemplar's picture and scene. The scene is written last: it marks a whole picture."""
    stem = folder / split / f"{index:06d}"
    return stem.with_suffix(".exr"), stem.with_suffix(".json")


def pack_path(folder: Path, split: Split, index: int) -> Path:
    """The tar file that an exemplar's files are packed into."""
    return folder / f"{split}-{index // PACK:04d}.tar"


def save_exemplar(path: Path, rendering: Rendering) -> None:
    """Writes premultiplied linear radiance and coverage as a half-float RGBA picture."""
    red, green, blue = rendering.image.clamp(max=BRIGHTEST).unbind(-1)
    save_exr(path, {"R": red, "G": green, "B": blue, "A": rendering.coverage}, half=True)


def load_picture(path: Path) -> Float[Tensor, "height width 4"]:
    """An exemplar's picture as stored: premultiplied RGB and coverage, half precision."""
    channels = load_exr(path)
    try:
        return torch.stack([channels[name] for name in "RGBA"], dim=-1).half()
    except KeyError as error:
        raise AssetError(f"{path} has no channel {error}; it is not an exemplar's picture.") from error


class SplitFiles:
    """The exemplars of a split that are complete, loose or packed. Of one that is both, the loose files count.

    As a context manager it deletes, when the block ends, what it has unpacked.

    Raises:
        AssetError: a tar file is damaged.
    """

    def __init__(self, folder: Path, split: Split) -> None:
        self._folder, self._split = folder, split
        records = (_FILE.fullmatch(path.name) for path in (folder / split).glob("*.json"))
        self._loose = {int(found[1]) for found in records if found}
        self._packed: dict[int, _Pack] = {}
        for path in sorted(folder.glob(f"{split}-[0-9]*.tar")):
            pack = _Pack(path)
            self._packed |= dict.fromkeys(pack.numbers, pack)
        self._scratch = ExitStack()
        self._unpacked: Path | None = None

    def __enter__(self) -> SplitFiles:
        return self

    def __exit__(self, *_: object) -> None:
        self._scratch.close()

    @property
    def numbers(self) -> set[int]:
        """Those of the complete exemplars."""
        return self._loose | self._packed.keys()

    @contextmanager
    def exemplar(self, number: int) -> Iterator[tuple[Path, Path]]:
        """Picture and scene, with its other files beside them. Packed ones, of one at a time, are there in the block.

        Raises:
            AssetError: the block raised one, or the tar file cannot be read. It names the tar file.
            KeyError: there is no such exemplar.
        """
        if number in self._loose:
            yield exemplar_paths(self._folder, self._split, number)
            return
        if self._unpacked is None:
            self._unpacked = self._scratch.enter_context(scratch_folder())
        with self._packed[number].unpacked(number, self._unpacked):
            yield self._unpacked / f"{number:06d}.exr", self._unpacked / f"{number:06d}.json"

    def remove_loose(self) -> None:
        """Removes all loose files of packed exemplars, the scenes first, and then the folder if it is empty.

        Raises:
            AssetError: a file cannot be removed.
        """
        folder = self._folder / self._split
        found = [(path, _FILE.fullmatch(path.name)) for path in sorted(folder.glob("[0-9]*"))]
        files = [path for path, name in found if name is not None and int(name[1]) in self._packed]
        with writing(folder):
            for path in sorted(files, key=lambda path: path.suffix != ".json"):
                path.unlink()
            with suppress(OSError):  # there are others
                folder.rmdir()


@contextmanager
def packing(path: Path) -> Iterator[Callable[[Path], None]]:
    """Writes a tar file, of what the block adds to it. Equal files make equal bytes.

    Raises:
        AssetError: the tar file cannot be written.
    """
    with atomic_path(path) as temporary, tarfile.open(temporary, "w", format=tarfile.USTAR_FORMAT) as tar:

        def add(file: Path) -> None:
            member = tarfile.TarInfo(file.name)  # without owner and time
            member.size = file.stat().st_size
            with file.open("rb") as content:
                tar.addfile(member, content)

        yield add


class _Pack:
    """A tar file of exemplars. Members of any other name or kind are passed over."""

    def __init__(self, path: Path) -> None:
        self._path = check_file(path, (".tar",), "packed exemplars")
        self._places: dict[int, list[tuple[str, int, int]]] = {}
        with parsing(path, "a tar file"), tarfile.open(path, "r:") as tar:
            for count, member in enumerate(tar):
                if count >= PACK * _FILES:
                    raise AssetError(f"{path} has more than {PACK * _FILES:,} files; it is no pack of exemplars.")
                name = _FILE.fullmatch(member.name)
                if name is not None and member.isreg() and not member.issparse():
                    place = (member.name, member.offset_data, member.size)
                    self._places.setdefault(int(name[1]), []).append(place)

    @property
    def numbers(self) -> list[int]:
        """The exemplars whose scene is there."""
        return [number for number, places in self._places.items() if any(name.endswith(".json") for name, *_ in places)]

    @contextmanager
    def unpacked(self, number: int, folder: Path) -> Iterator[None]:
        """The files of an exemplar are in the folder, for the time of the block."""
        try:
            with self._path.open("rb") as tar:
                for name, start, size in self._places[number]:
                    tar.seek(start)
                    with writing(folder / name), (folder / name).open("wb") as file:
                        for done in range(0, size, _CHUNK):
                            file.write(tar.read(min(_CHUNK, size - done)))
            yield
        except SvbrdfganError as error:
            raise type(error)(str(error).replace(str(folder), str(self._path))) from error
        finally:
            for name, *_ in self._places[number]:
                (folder / name).unlink(missing_ok=True)
