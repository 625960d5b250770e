"""`python tests/asset/files_table.py ASSETS`: prints the table of `docs/assets.md`, in some minutes."""

import logging
import sys
import tempfile
from pathlib import Path

sys.path.append(str(Path(__file__).parent))  # as conftest.py does for tests

from full_files import FullFile, full_files
from validator import validated
from weathered_files import weathered

HEADINGS = ("file", "what is in it", "pieces that weather", "second UV set", "differences", "validator errors")


def row(file: FullFile, folder: Path) -> str:
    """The line of one file."""
    changed = weathered(file.path, folder)
    before, after = (len(errors) for errors in validated([file.path, changed.path]))
    pieces = f"{len(changed.weathers)} of {len(changed.asset.pieces)}"
    second = "yes" if changed.has_second_uv_set else "no"
    return (
        f"| {_name(file)} | {contents(file)} | {pieces} | {second} | {len(changed.differences())} | {before}, {after} |"
    )


def contents(file: FullFile) -> str:
    """Numbers of triangles and materials, and whatever is unusual."""
    prefixes = ("KHR_", "EXT_", "materials_", "mesh_", "texture_")
    words = sorted(file.extensions)
    for prefix in prefixes:
        words = [word.removeprefix(prefix) for word in words]
    moving = [f"{count} {name}" for name in ("animations", "skins") if (count := getattr(file, name))]
    plain = [f"{file.triangles} triangles", f"{file.materials} materials"]
    return ", ".join([*plain, *moving, *sorted(file.features - {"dbl", "extras", "tan"}), *words])


def _line(*cells: object) -> str:
    return f"| {' | '.join(map(str, cells))} |"


def _name(file: FullFile) -> str:
    return file.name.partition("/")[0].partition(".")[0]


def main(assets: Path) -> None:
    logging.disable(logging.WARNING)
    print(_line(*HEADINGS), _line(*["---"] * len(HEADINGS)), sep="\n")
    for file in full_files(assets):
        with tempfile.TemporaryDirectory() as folder:
            empty = _line(_name(file), "no faces: refused", *["-"] * 4)
            print(row(file, Path(folder)) if file.triangles else empty, flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
