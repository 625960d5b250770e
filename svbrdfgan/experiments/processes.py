"""Runs tasks, each in its own process, several at once, so that a task that fails or aborts stops no other.

Two libraries were tried and do not suffice: one aborted process breaks the whole pool of `concurrent.futures`; doit has
no time limit, and its children outlive it if it is killed.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch

from svbrdfgan.config.models import StrictModel
from svbrdfgan.utils.display import Display
from svbrdfgan.utils.processes import cores, import_path

OUTPUT = "output.txt"
_POLL_SECONDS = 0.2
_VISIBLE = "CUDA_VISIBLE_DEVICES"


class Task(StrictModel):
    """A task that writes its results into a folder.

    Attributes:
        title: name of the task, for display.
        root: folder of all experiments, which holds data sets, oracles and runs.
        folder: relative to the root.
        assets: folder that file patterns are relative to.
    """

    title: str
    root: str
    folder: str
    assets: str

    @property
    def path(self) -> Path:
        return Path(self.root) / self.folder

    @property
    def needs(self) -> tuple[str, ...]:
        """Folders of the tasks that must be done before this one."""
        return ()


class Schedule:
    """Tasks in order of preference. A task can be taken once those that it needs have ended; its taker calls `end`."""

    def __init__(self, tasks: Iterable[Task]) -> None:
        self._waiting = {task.folder: task for task in tasks}
        self._open = set(self._waiting)

    def __len__(self) -> int:
        """The number of tasks that have not ended."""
        return len(self._open)

    def take(self) -> Task | None:
        """The first waiting task whose needs have ended; None if there is none at present."""
        for task in self._waiting.values():
            if not self._open & set(task.needs):
                return self._waiting.pop(task.folder)
        return None

    def end(self, task: Task, reason: str | None) -> Iterator[tuple[Task, str | None]]:
        """Ends a task, which failed if there is a `reason`. Yields it, and then all that fail because they need it."""
        self._open.discard(task.folder)
        yield task, reason
        if reason is None:
            return
        for other in list(self._waiting.values()):
            if task.folder in other.needs and self._waiting.pop(other.folder, None) is not None:
                yield from self.end(other, f"{task.title}: {reason}")


Execute = Callable[[Schedule, int, float, Display], Generator[tuple[Task, str | None], None, None]]
"""Runs tasks, like `execute`: yields each task that ends, and the reason if it failed."""


@dataclass(frozen=True)
class _Child:
    task: Task
    process: subprocess.Popen[bytes]
    gpu: str | None

    def reason(self) -> str | None:
        """The reason why the task failed, usually the last line of its output; None if it succeeded."""
        code = self.process.returncode
        if code == 0:
            return None
        if code < 0:  # `subprocess` reports a signal as a negative code
            return f"it was ended by signal {-code}"
        lines = (self.task.path / OUTPUT).read_text(encoding="utf-8", errors="replace").strip().splitlines()
        return lines[-1].strip() if lines else f"it ended with exit code {code}"

    def terminate(self) -> None:
        """Ends the process and its children if it is still running."""
        if self.process.poll() is not None:
            return
        if os.name == "posix":
            os.killpg(self.process.pid, signal.SIGTERM)
        else:
            self.process.terminate()


def gpus() -> list[str]:
    """The GPUs that this process may use, named as in `CUDA_VISIBLE_DEVICES`."""
    visible = os.environ.get(_VISIBLE)
    if visible is None:
        return [str(number) for number in range(torch.cuda.device_count())]
    return [name.strip() for name in visible.split(",") if name.strip()]


def execute(
    schedule: Schedule, jobs: int, until: float, display: Display
) -> Generator[tuple[Task, str | None], None, None]:
    """Runs up to `jobs` tasks at once, spread over the GPUs. Each task writes its output to `output.txt` in its folder.

    At the time `until` of `time.monotonic`, or when the generator is closed, all running tasks are ended.
    """
    running, devices = list[_Child](), gpus()
    try:
        while len(schedule) and time.monotonic() < until:
            while len(running) < jobs and (task := schedule.take()) is not None:
                running.append(_start(task, jobs, _least_used(devices, running)))
                display.advance(0, task.title)
            time.sleep(_POLL_SECONDS)
            for child in [child for child in running if child.process.poll() is not None]:
                running.remove(child)
                yield from schedule.end(child.task, child.reason())
    finally:
        for child in running:
            child.terminate()
        for child in running:
            child.process.wait()


def _least_used(devices: Sequence[str], running: Sequence[_Child]) -> str | None:
    """The GPU with the fewest running tasks; None if there is no GPU."""
    used = [child.gpu for child in running]
    return min(devices, key=used.count, default=None)


def _start(task: Task, jobs: int, gpu: str | None) -> _Child:
    """Starts the process of a task, with its share of the cores."""
    threads = {"OMP_NUM_THREADS": str(max(1, cores() // jobs))} if jobs > 1 else {}
    device = {} if gpu is None else {_VISIBLE: gpu}
    task.path.mkdir(parents=True, exist_ok=True)
    with (task.path / OUTPUT).open("wb") as output:
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", "svbrdfgan.experiments.job", str(os.getpid())],
            stdin=subprocess.PIPE,
            stdout=output,
            stderr=subprocess.STDOUT,
            env={**threads, **os.environ, **device, "PYTHONPATH": import_path()},
            process_group=0 if os.name == "posix" else None,  # so that `terminate` ends its children too
        )
    assert process.stdin is not None
    process.stdin.write(task.model_dump_json().encode())
    process.stdin.close()
    return _Child(task, process, gpu)
