"""The metrics log of a run: one line of JSON per report, and TensorBoard files if TensorBoard is installed."""

from __future__ import annotations

import json
import logging
from pathlib import Path
from typing import Any

from jaxtyping import Float
from torch import Tensor

from svbrdfgan.io.atomic import atomic_path
from svbrdfgan.training.run import LOG

log = logging.getLogger(__name__)


class MetricsLog:
    """Appends to a run's log, after dropping lines past `step`, which an interrupted run wrote."""

    def __init__(self, run: Path, step: int) -> None:
        self.path = run / LOG
        kept = [line for line in read_metrics(run) if line["step"] <= step]
        with atomic_path(self.path) as temporary:
            temporary.write_text("".join(json.dumps(line) + "\n" for line in kept), encoding="utf-8")
        self.board = _board(run, step)

    def write(self, step: int, values: dict[str, float]) -> None:
        """Logs numbers."""
        with self.path.open("a", encoding="utf-8") as file:
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
    """The lines of a run's log. A line that a kill cut off is left out."""
    lines: list[dict[str, float]] = []
    if (run / LOG).is_file():
        for line in (run / LOG).read_text(encoding="utf-8").splitlines():
            try:
                lines.append(json.loads(line))
            except ValueError:
                log.info("a line of %s was cut off and is left out", run / LOG)
    return lines


def _board(run: Path, step: int) -> Any:
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        log.info("TensorBoard is not installed; pip install 'svbrdfgan[tensorboard]' for its curves and pictures")
        return None
    return SummaryWriter(str(run / "tensorboard"), purge_step=step + 1 if step else None)
