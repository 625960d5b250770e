"""The files that `weather` and `texture` write: where they lie, and what came of each mesh."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from svbrdfgan.cli.display import echo, print_json
from svbrdfgan.cli.options import require_writable
from svbrdfgan.errors import ConfigError, SvbrdfganError
from svbrdfgan.io.files import require_apart


def results(
    meshes: tuple[Path, ...], out: Path, *, force: bool, draws: Sequence[str] | None = None
) -> list[list[Path]]:
    """Where the results of each mesh are written: `out` itself, or files in the folder `out` if there are several.

    Args:
        draws: of several results of each mesh, the ends of their names.

    Raises:
        AssetError: a result would overwrite a mesh.
        ConfigError: a result would overwrite another or, without `force`, an earlier one.
    """
    if len(meshes) == 1 and draws is None:
        paths = [[out]]
    else:
        ends = [""] if draws is None else [f"-{draw}" for draw in draws]
        paths = [[out / f"{mesh.stem}{end}.glb" for end in ends] for mesh in meshes]
    for path, times in Counter(path for some in paths for path in some).items():
        if times > 1:
            raise ConfigError(f"two meshes would be written to {path}; weather them one after the other.")
        for mesh in meshes:
            _require_free(mesh, path, force=force)
    return paths


def _require_free(mesh: Path, path: Path, *, force: bool) -> None:
    """Refuses to overwrite a mesh or, without `force`, an earlier result; makes the folder of a result.

    Raises:
        AssetError: the path is the mesh's.
        ConfigError: the path is not one that can be written.
    """
    require_apart(mesh, path)
    if path.exists() and not force:
        raise ConfigError(f"{path} is there already; --force overwrites it.")
    require_writable(path, ".glb", ".gltf")


@dataclass
class Done:
    """What comes of work on one mesh after the other.

    Attributes:
        written: paths, by the number of their mesh.
        errors: sentences, by the number of the mesh that failed.
    """

    meshes: tuple[Path, ...]
    written: dict[int, list[Path]] = field(default_factory=dict)
    errors: dict[int, str] = field(default_factory=dict)

    def each_alone(self, work: Callable[[int], Iterable[Path]]) -> None:
        """Does work on each mesh, by number; it yields what was written.

        If there are several, one that fails is told and does not stop the others.

        Raises:
            SvbrdfganError: the only mesh failed.
        """
        for number, mesh in enumerate(self.meshes):
            self.written[number] = []
            try:
                self.written[number].extend(work(number))
            except SvbrdfganError as error:
                if len(self.meshes) == 1:
                    raise
                echo(f"Error: {mesh}: {error}", err=True)
                self.errors[number] = str(error)

    def kept(self) -> str:
        """What Ctrl-C leaves."""
        if not self._paths:
            return "nothing was written."
        return f"written are {', '.join(self._paths)}; to go on, name the other meshes or seeds."

    def report(self, *, as_json: bool) -> None:
        """Prints the paths written, or for programs what came of each mesh.

        Raises:
            ConfigError: some meshes failed.
        """
        if as_json:
            print_json([self._record(number) for number in range(len(self.meshes))])
        else:
            for path in self._paths:
                echo(path)
        if self.errors:
            raise ConfigError(f"{len(self.errors)} of {len(self.meshes)} meshes could not be weathered; see above.")

    @property
    def _paths(self) -> list[str]:
        return [str(path) for paths in self.written.values() for path in paths]

    def _record(self, number: int) -> dict[str, object]:
        written = list(map(str, self.written[number]))
        return {"mesh": str(self.meshes[number]), "written": written, "error": self.errors.get(number)}
