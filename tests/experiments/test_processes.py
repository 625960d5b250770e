"""Processes: several at once, each one's failure its own."""

from __future__ import annotations

import math
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from svbrdfgan.data.config import dataset_config
from svbrdfgan.experiments.processes import OUTPUT, Schedule, execute, gpus
from svbrdfgan.experiments.tasks import DatasetTask
from svbrdfgan.utils.display import SilentDisplay

Stand_In = Callable[[str], None]


def task(root: Path, name: str, **changes: object) -> DatasetTask:
    splits = {"train": {"meshes": {"procedural": {"count": 1}}, "views": 1}}
    config = dataset_config({"splits": splits, **changes}, "here")
    return DatasetTask(title=name, root=str(root), folder=name, assets="", config=config, workers=1)


@pytest.fixture
def stand_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Stand_In:
    """Puts a shell script in Python's place; what a task is stands in its stdin."""

    def put(script: str) -> None:
        program = tmp_path / "python"
        program.write_text(f"#!/bin/sh\ntask=$(cat)\n{script}\n")
        program.chmod(0o755)
        monkeypatch.setattr(sys, "executable", str(program))

    return put


def test_the_reason_of_a_failure_is_its_last_line(stand_in: Stand_In, tmp_path: Path) -> None:
    stand_in('case "$task" in *\'"title":"bad"\'*) echo much; echo "car.glb has no faces." >&2; exit 1;; esac')
    ended = {
        made.title: reason
        for made, reason in execute(
            Schedule([task(tmp_path, n) for n in ("bad", "good")]), 2, math.inf, SilentDisplay()
        )
    }
    assert ended == {"bad": "car.glb has no faces.", "good": None}
    assert (tmp_path / "bad" / OUTPUT).read_text() == "much\ncar.glb has no faces.\n"


def test_a_process_that_aborts_is_a_failure(stand_in: Stand_In, tmp_path: Path) -> None:
    stand_in("kill -ABRT $$")
    ((_, reason),) = execute(Schedule([task(tmp_path, "a")]), 1, math.inf, SilentDisplay())
    assert reason == "it was ended by signal 6"
    stand_in("exit 3")
    ((_, reason),) = execute(Schedule([task(tmp_path, "a")]), 1, math.inf, SilentDisplay())
    assert reason == "it ended with exit code 3"


def test_as_many_at_once_as_jobs(stand_in: Stand_In, tmp_path: Path) -> None:
    counted = f'found=$(ls {tmp_path} | grep -c "^in"); echo $found'
    two = f"until [ -e {tmp_path}/two ]; do {counted}; [ $found -ge 2 ] && touch {tmp_path}/two; sleep 0.01; done"
    stand_in(f"touch {tmp_path}/in.$$; {two}; sleep 0.1; {counted}; rm {tmp_path}/in.$$")
    tasks = [task(tmp_path, f"t{number}") for number in range(5)]
    assert len(list(execute(Schedule(tasks), 2, math.inf, SilentDisplay()))) == 5
    assert max(int(found) for made in tasks for found in (made.path / OUTPUT).read_text().split()) == 2


def slow_beside_others(folder: Path) -> str:
    """The script of a slow task that writes down its process, and of others that end when it has."""
    wrote = f"until [ -s {folder}/slow.pid ]; do sleep 0.01; done"
    return f'case "$task" in *\'"title":"slow"\'*) echo $$ > {folder}/slow.pid; exec sleep 600;; *) {wrote};; esac'


def test_closing_the_generator_ends_them(stand_in: Stand_In, ended: Callable[[int], bool], tmp_path: Path) -> None:
    stand_in(slow_beside_others(tmp_path))
    running = execute(Schedule([task(tmp_path, n) for n in ("quick", "slow")]), 2, math.inf, SilentDisplay())
    assert next(running)[0].title == "quick"
    running.close()
    assert ended(int((tmp_path / "slow.pid").read_text()))


def test_ended_tasks_are_not_ended_again(stand_in: Stand_In, ended: Callable[[int], bool], tmp_path: Path) -> None:
    """Several end at once, and the generator is closed after the first."""
    stand_in(slow_beside_others(tmp_path))
    tasks = [task(tmp_path, name) for name in ("quick", "too", "slow")]
    running = execute(Schedule(tasks), 3, math.inf, SilentDisplay())
    next(running)
    running.close()
    assert ended(int((tmp_path / "slow.pid").read_text()))


def test_when_time_is_up_they_are_ended(stand_in: Stand_In, ended: Callable[[int], bool], tmp_path: Path) -> None:
    """With what they started; and nothing is said to have failed."""
    stand_in(f"sleep 600 & echo $! > {tmp_path}/child; wait")
    began = time.monotonic()
    schedule = Schedule([task(tmp_path, name) for name in ("a", "b")])
    assert list(execute(schedule, 1, began + 2, SilentDisplay())) == []
    assert time.monotonic() >= began + 2
    assert len(schedule) == 2
    assert not (tmp_path / "b").exists()
    assert ended(int((tmp_path / "child").read_text()))


def test_tasks_are_spread_over_the_gpus(stand_in: Stand_In, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "4, GPU-b")
    assert gpus() == ["4", "GPU-b"]
    stand_in("echo $CUDA_VISIBLE_DEVICES; sleep 0.5")
    tasks = [task(tmp_path, f"t{number}") for number in range(4)]
    assert len(list(execute(Schedule(tasks), 4, math.inf, SilentDisplay()))) == 4
    assert [(made.path / OUTPUT).read_text().strip() for made in tasks] == ["4", "GPU-b"] * 2


def test_a_task_ends_when_its_parent_is_killed() -> None:
    """And so do its own children."""
    job = (
        "import os, subprocess, time; from svbrdfgan.utils.processes import end_with_parent;"
        "end_with_parent(os.getppid());"
        "subprocess.Popen(['sleep', '600']);"
        "print('ready', flush=True); time.sleep(600)"
    )
    between = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {job!r}], process_group=0)"
    with subprocess.Popen([sys.executable, "-c", between], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"ready\n"
        began = time.monotonic()
        process.kill()
        assert process.stdout.read() == b""  # both have let go of it
        assert time.monotonic() - began < 60


def test_a_task_ends_whose_parent_is_already_dead() -> None:
    job = "from svbrdfgan.utils.processes import end_with_parent; import time;end_with_parent(0); time.sleep(600)"
    ended = subprocess.run([sys.executable, "-c", job], process_group=0, timeout=120)
    assert ended.returncode == -signal.SIGKILL


@pytest.mark.full
def test_a_real_task_and_what_it_refuses(tmp_path: Path) -> None:
    """The process reads the task, and its one sentence comes back."""
    ((_, reason),) = execute(
        Schedule([task(tmp_path, "wrong", embedding="hemisferical")]), 1, math.inf, SilentDisplay()
    )
    assert reason is not None
    assert "hemisferical" in reason
    assert "Traceback" not in (tmp_path / "wrong" / OUTPUT).read_text()
