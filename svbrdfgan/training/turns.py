"""Learns from photographs in turns: imports them by what the last run has learned, and trains on from that run.

OUT/turns.json         what was declared when the first turn began
OUT/turn-1/exemplars   the data set of the pictures, as `svbrdfgan dataset import` makes it
OUT/turn-1/run         the run that learned from it
OUT/turn-2/...
"""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from svbrdfgan.config.models import differences
from svbrdfgan.data.index import INDEX
from svbrdfgan.data.photos.build import import_pictures
from svbrdfgan.data.photos.manifest import Manifest
from svbrdfgan.errors import ConfigError
from svbrdfgan.io.atomic import atomic_path
from svbrdfgan.io.claims import claimed_folder
from svbrdfgan.io.records import load_json
from svbrdfgan.training.config import TrainConfig
from svbrdfgan.training.resolve import make_fabric, resolve_config
from svbrdfgan.training.run import FREE, MODEL
from svbrdfgan.training.state import checkpoints
from svbrdfgan.training.trainer import is_finished, train
from svbrdfgan.utils.display import Display, SilentDisplay

RECORD = "turns.json"
_SHARE = 0.6
"""Steps of a later turn, relative to the first: 1,500 and then 900 were measured."""
_TOLD = 3
"""The most differences that a message names."""

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Lessons:
    """What every turn has in common.

    Attributes:
        manifest: of the pictures; its `model` counts for the first turn.
        manifest_file: its name opens messages, and the manifest's paths are relative to its folder.
        config: of the runs; its `dataset` has no meaning, and its `init` and `steps` count for the first turn.
        config_base: the folder that the paths of `config` are relative to.
        later_steps: of the second turn and those after it; None: three fifths of the first turn's.
    """

    manifest: Manifest
    manifest_file: Path
    config: TrainConfig
    config_base: Path
    later_steps: int | None = None

    def manifest_of(self, before: Path | None) -> Manifest:
        """The manifest of the turn after the run `before`."""
        return self.manifest if before is None else self.manifest.model_copy(update={"model": str(before.resolve())})

    def config_of(self, before: Path | None, exemplars: Path) -> TrainConfig:
        """The training configuration of the turn after the run `before`."""
        changed: dict[str, Any] = {"dataset": str(exemplars.resolve())}
        if before is not None:
            changed |= {"init": str(before.resolve()), "steps": self._later_steps}
        return self.config.model_copy(update=changed)

    @property
    def record(self) -> dict[str, Any]:
        """What must not change between the turns, as JSON."""
        free = {key: value for key, value in FREE["train"].items() if key not in ("steps", "init")}
        return {
            "manifest": self.manifest.model_dump(mode="json"),
            "train": self.config.model_dump(mode="json", exclude=free),
            "later_steps": self._later_steps,
        }

    @property
    def _later_steps(self) -> int:
        return self.later_steps or max(1, round(_SHARE * self.config.steps))


def take_turns(
    lessons: Lessons, out: Path, turns: int, *, workers: int | None = 1, display: Display | None = None
) -> Path:
    """Takes those turns that the folder does not hold yet, and goes on with one that was stopped.

    Args:
        workers: processes that share the pictures of an import, as for `import_pictures`.

    Returns:
        The folder of the last turn's run.

    Raises:
        ConfigError: the manifest, the configuration or files that they name have errors; or the folder holds something
            else, or turns by other settings.
        AssetError: a file cannot be read or written.
        TrainingError: a loss is not finite.
        KeyboardInterrupt: after Ctrl-C; the same call goes on.
    """
    display, before = display or SilentDisplay(), None
    with claimed_folder(out):
        _require_free(out, lessons)
        # faults of the run are found before the pictures are imported, which takes long
        make_fabric(lessons.config.device, devices=lessons.config.devices, precision=lessons.config.precision)
        resolve_config(lessons.config, lessons.manifest.config(), lessons.config_base)
        for number in range(1, turns + 1):
            run = run_folder(out, number)
            if not ((run / MODEL).is_file() and is_finished(run)):
                display.begin(f"turn {number} of {turns}")
                exemplars = _exemplars(out, number)
                if not (exemplars / INDEX).is_file():
                    with _begun(out, exemplars, lessons):
                        _import(lessons, before, exemplars, workers, display)
                config = lessons.config_of(before, exemplars)
                train(config, run, base=lessons.config_base, resume=bool(checkpoints(run)), display=display)
            before = run
        return run


def run_folder(out: Path, number: int) -> Path:
    """The folder of a turn's run; turns count from 1."""
    return out / f"turn-{number}" / "run"


def _exemplars(out: Path, number: int) -> Path:
    return out / f"turn-{number}" / "exemplars"


def _import(lessons: Lessons, before: Path | None, exemplars: Path, workers: int | None, display: Display) -> None:
    manifest, file = lessons.manifest_of(before), lessons.manifest_file
    imported = import_pictures(
        manifest, exemplars, base=file.parent, source=str(file), workers=workers, display=display
    )
    for picture in imported if before is None else ():
        for doubt in picture.doubts:
            log.warning("%s: %s (see %s)", picture.file, doubt, exemplars / picture.overlay)


def _require_free(out: Path, lessons: Lessons) -> None:
    """Refuses a folder that holds something else, or turns by other settings."""
    if not (out / RECORD).is_file():
        if out.is_file() or (out.is_dir() and any(out.iterdir())):
            raise ConfigError(f"{out} already exists and holds no turns; choose another folder or delete it.")
        return
    if not any(out.glob(f"turn-*/exemplars/{INDEX}")):
        return  # nothing was made by those settings
    changed = differences(_numbered(load_json(out / RECORD)), _numbered(lessons.record))
    if changed:
        more = f"; and {len(changed) - _TOLD} more" if len(changed) > _TOLD else ""
        raise ConfigError(
            f"{out} was begun with other settings ({'; '.join(changed[:_TOLD])}{more}); choose another folder or "
            "delete it."
        )


def _numbered(value: Any) -> Any:
    """The same data with lists of mappings as mappings, so that a difference names a picture and its key."""
    if isinstance(value, list) and any(isinstance(each, dict) for each in value):
        value = {str(number): each for number, each in enumerate(value)}
    return {key: _numbered(each) for key, each in value.items()} if isinstance(value, dict) else value


@contextmanager
def _begun(out: Path, exemplars: Path, lessons: Lessons) -> Iterator[None]:
    """Writes the record before the block; removes it, and empty folders, if nothing was made."""
    with atomic_path(out / RECORD) as temporary:
        temporary.write_text(json.dumps(lessons.record, indent=1) + "\n", encoding="utf-8")
    try:
        yield
    finally:
        with suppress(OSError):  # it is not empty, or not there
            exemplars.parent.rmdir()
        if not any(out.glob("turn-*")):
            (out / RECORD).unlink()
            with suppress(OSError):
                out.rmdir()
