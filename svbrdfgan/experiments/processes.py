"""Tasks in processes of their own, several at once: one that fails, or aborts, disturbs no other."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from svbrdfgan.display import Display
from svbrdfgan.experiments.tasks import Order, Task
from svbrdfgan.processes import cores, import_path

OUTPUT = "output.txt"
_PAUSE = 0.2

Execute = Callable[[Sequence[Task], int, Display], Iterator[tuple[Task, str | None]]]
"""Does tasks, so many at once, and yields each as it ends, with the reason if it failed."""


@dataclass(frozen=True)
class _Child:
    task: Task
    process: subprocess.Popen[bytes]

    def reason(self) -> str | None:
        """Why it failed: the last line that it wrote; None if it did not."""
        code = self.process.returncode
        if code == 0:
            return None
        if code < 0:
            return f"it was ended by signal {-code}"
        lines = (self.task.path / OUTPUT).read_text(encoding="utf-8", errors="replace").strip().splitlines()
        return lines[-1].strip() if lines else f"it ended with exit code {code}"


def execute(tasks: Sequence[Task], jobs: int, display: Display) -> Iterator[tuple[Task, str | None]]:
    """Does tasks; what a task prints goes to `output.txt` in its folder. Whoever stops asking ends them all."""
    waiting, running = deque(tasks), list[_Child]()
    try:
        while waiting or running:
            while waiting and len(running) < jobs:
                running.append(_start(waiting.popleft(), jobs))
                display.advance(0, running[-1].task.title)
            time.sleep(_PAUSE)
            for child in [child for child in running if child.process.poll() is not None]:
                running.remove(child)
                yield child.task, child.reason()
    finally:
        for child in running:
            child.process.terminate()
        for child in running:
            child.process.wait()


def _start(task: Task, jobs: int) -> _Child:
    """Several at once share the cores out among them."""
    shared = {"OMP_NUM_THREADS": str(max(1, cores() // jobs))} if jobs > 1 else {}
    task.path.mkdir(parents=True, exist_ok=True)
    with (task.path / OUTPUT).open("wb") as output:
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", "svbrdfgan.experiments.job"],
            stdin=subprocess.PIPE,
            stdout=output,
            stderr=subprocess.STDOUT,
            env={**shared, **os.environ, "PYTHONPATH": import_path()},
        )
    assert process.stdin is not None
    process.stdin.write(Order(task=task).model_dump_json().encode())
    process.stdin.close()
    return _Child(task, process)
