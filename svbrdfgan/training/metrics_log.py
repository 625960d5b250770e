"""The metrics log of a run: one line of JSON per report, and TensorBoard files if TensorBoard is installed."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from jaxtyping import Float
from torch import Tensor

from svbrdfgan.io.atomic import atomic_path, writing
from svbrdfgan.training.run import LOG

_MOST = 20_000
"""Lines of a log that are kept in memory."""
_LONGEST = 100_000
"""Characters of a line."""

log = logging.getLogger(__name__)


class MetricsLog:
    """Appends to a run's log, after dropping lines past `step`, which an interrupted run wrote."""

    def __init__(self, run: Path, step: int) -> None:
        self.path = run / LOG
        with atomic_path(self.path) as temporary, temporary.open("w", encoding="utf-8") as file:
            file.writelines(json.dumps(line) + "\n" for line in _lines(self.path) if line["step"] <= step)
        self.board = _board(run, step)

    def write(self, step: int, values: dict[str, float]) -> None:
        """Logs numbers.

        Raises:
            AssetError: the file cannot be written.
        """
        with writing(self.path), self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps({"step": step, **values}) + "\n")
        if self.board is not None:
            for name, value in values.items():
                self.board.add_scalar(name, value, step)

    def add_image(self, step: int, name: str, image: Float[Tensor, "height width 3"]) -> None:
        """Logs a display-referred image with values in [0, 1], to TensorBoard alone."""
        if self.board is not None:
            self.board.add_image(name, image, step, dataformats="HWC")

    def close(self) -> None:
        if self.board is not None:
            self.board.close()


def read_metrics(run: Path) -> list[dict[str, float]]:
    """The lines of a run's log, and of very many every second, fourth and so on, and the last.

    A line that a kill cut off, or that is no report, is left out.
    """
    kept: list[dict[str, float]] = []
    every, last = 1, None
    for number, line in enumerate(_lines(run / LOG)):
        last = line
        if number % every == 0:
            kept.append(line)
        if len(kept) > _MOST:
            kept, every = kept[::2], 2 * every
    if last is not None and last is not kept[-1]:
        kept.append(last)
    return kept


def _lines(path: Path) -> Iterator[dict[str, float]]:
    """The reports in a log."""
    if not path.is_file():
        return
    with path.open(encoding="utf-8", errors="replace") as file:
        while text := file.readline(_LONGEST):
            try:
                line = json.loads(text)
            except (ValueError, RecursionError):
                line = None
            if _is_report(line):
                yield line
            else:
                log.info("a line of %s is no report and is left out", path)


def _is_report(line: object) -> bool:
    """Whether it has a step, and numbers alone."""
    return (
        isinstance(line, dict)
        and isinstance(line.get("step"), int)
        and all(isinstance(value, int | float) and not isinstance(value, bool) for value in line.values())
    )


def _board(run: Path, step: int) -> Any:
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        log.info("TensorBoard is not installed; pip install 'svbrdfgan[tensorboard]' for its curves and pictures")
        return None
    return SummaryWriter(str(run / "tensorboard"), purge_step=step + 1 if step else None)
