"""Tasks in processes of their own, several at once: one that fails, or aborts, disturbs no other."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass

import torch

from svbrdfgan.experiments.schedule import Schedule
from svbrdfgan.experiments.tasks import Order, Task
from svbrdfgan.utils.display import Display
from svbrdfgan.utils.processes import cores, import_path

OUTPUT = "output.txt"
_PAUSE = 0.2
_VISIBLE = "CUDA_VISIBLE_DEVICES"

Execute = Callable[[Schedule, int, float, Display], Generator[tuple[Task, str | None], None, None]]
"""Does what is scheduled, so many at once, until then, and yields each that ends, with the reason if it failed."""


@dataclass(frozen=True)
class _Child:
    task: Task
    process: subprocess.Popen[bytes]
    gpu: str | None

    def reason(self) -> str | None:
        """Why it failed: the last line that it wrote; None if it did not."""
        code = self.process.returncode
        if code == 0:
            return None
        if code < 0:
            return f"it was ended by signal {-code}"
        lines = (self.task.path / OUTPUT).read_text(encoding="utf-8", errors="replace").strip().splitlines()
        return lines[-1].strip() if lines else f"it ended with exit code {code}"

    def terminate(self) -> None:
        """Ends it and the processes that it started, if it has not ended."""
        if self.process.poll() is not None:
            return
        if os.name == "posix":
            os.killpg(self.process.pid, signal.SIGTERM)
        else:
            self.process.terminate()


def gpus() -> list[str]:
    """The names of those that this process may use, as `CUDA_VISIBLE_DEVICES` has them."""
    told = os.environ.get(_VISIBLE)
    if told is None:
        return [str(number) for number in range(torch.cuda.device_count())]
    return [name.strip() for name in told.split(",") if name.strip()]


def execute(
    schedule: Schedule, jobs: int, until: float, display: Display
) -> Generator[tuple[Task, str | None], None, None]:
    """Does tasks, spread over the GPUs; what a task prints goes to `output.txt` in its folder.

    When `until`, by `time.monotonic`, is over, or whoever asked stops asking, all that run are ended.
    """
    running, places = list[_Child](), gpus()
    try:
        while len(schedule) and time.monotonic() < until:
            while len(running) < jobs and (task := schedule.take()) is not None:
                running.append(_start(task, jobs, _least_used(places, running)))
                display.advance(0, task.title)
            time.sleep(_PAUSE)
            for child in [child for child in running if child.process.poll() is not None]:
                running.remove(child)
                yield from schedule.end(child.task, child.reason())
    finally:
        for child in running:
            child.terminate()
        for child in running:
            child.process.wait()


def _least_used(places: Sequence[str], running: Sequence[_Child]) -> str | None:
    taken = [child.gpu for child in running]
    return min(places, key=taken.count, default=None)


def _start(task: Task, jobs: int, gpu: str | None) -> _Child:
    """Several at once share the cores out among them."""
    shared = {"OMP_NUM_THREADS": str(max(1, cores() // jobs))} if jobs > 1 else {}
    placed = {} if gpu is None else {_VISIBLE: gpu}
    task.path.mkdir(parents=True, exist_ok=True)
    with (task.path / OUTPUT).open("wb") as output:
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", "svbrdfgan.experiments.job", str(os.getpid())],
            stdin=subprocess.PIPE,
            stdout=output,
            stderr=subprocess.STDOUT,
            env={**shared, **os.environ, **placed, "PYTHONPATH": import_path()},
            process_group=0 if os.name == "posix" else None,
        )
    assert process.stdin is not None
    process.stdin.write(Order(task=task).model_dump_json().encode())
    process.stdin.close()
    return _Child(task, process, gpu)
