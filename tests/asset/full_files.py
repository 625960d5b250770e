"""The 49 glTF files of `full/` in the assets, with what their manifest says of each."""

import csv
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class FullFile:
    """A file as artists make them, with the facts of its line in the manifest.

    `features` are the manifest's abbreviations: `vcol` vertex colours, `dbl` doubleSided, `tan` tangents,
    `cam` cameras, `MASK` and `BLEND` alpha modes, `morph`, `sparse`, `extras`, `scenes2`. `error_count` is what the
    validator finds among its first 200 issues; `error_codes` also has the warnings of files with errors.
    """

    name: str
    path: Path
    is_vehicle: bool
    nodes: int
    meshes: int
    triangles: int
    materials: int
    textures: int
    uv_sets: int
    animations: int
    skins: int
    extensions: frozenset[str]
    features: frozenset[str]
    error_count: int
    error_codes: Counter[str]


NUMBERS = ("nodes", "meshes", "triangles", "materials", "textures", "uv_sets", "animations", "skins")


def full_files(assets: Path) -> list[FullFile]:
    """Every file of the manifest, in its order, from the folder of assets."""
    folder = assets / "full"
    with (folder / "MANIFEST.tsv").open(encoding="utf-8", newline="") as lines:
        return [_full_file(folder, row) for row in csv.DictReader(lines, delimiter="\t")]


def vehicles(assets: Path) -> list[FullFile]:
    """The files of the manifest that show vehicles."""
    return [file for file in full_files(assets) if file.is_vehicle]


def _full_file(folder: Path, row: dict[str, Any]) -> FullFile:
    return FullFile(
        name=row["file"],
        path=folder / row["file"],
        is_vehicle=row["kind"] == "vehicle",
        extensions=_words(row["extensionsUsed"]),
        features=_words(row["features"]),
        error_count=int(row["validator_errors"]),
        error_codes=_counts(row["validator_error_codes"]),
        **{name: int(row[name]) for name in NUMBERS},
    )


def _words(cell: str) -> frozenset[str]:
    return frozenset(() if cell == "-" else cell.split(","))


def _counts(cell: str) -> Counter[str]:
    """Error codes with their numbers, from `CODEx2,OTHERx1`."""
    pairs = (word.rpartition("x") for word in _words(cell))
    return Counter({code: int(count) for code, _, count in pairs})
