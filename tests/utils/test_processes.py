"""Worker processes end without a word when Ctrl-C ends the command."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from multiprocessing import get_context
from pathlib import Path

import pytest

from svbrdfgan.utils import processes

POOL = """
import os, sys, time
from svbrdfgan.errors import SvbrdfganError
from svbrdfgan.utils.processes import worker_pool
try:
    with worker_pool(2, "sleeps", "--workers") as pool:
        if sys.argv[1] == "busy":
            pool.submit(os.getpid).result()
        sleeping = [pool.submit(time.sleep, 600) for _ in range(5)]
        print("begun", *pool._processes if sys.argv[1] == "busy" else (), flush=True)
        sleeping[0].result()
except KeyboardInterrupt:
    sys.exit(130)
except SvbrdfganError as error:
    sys.exit(f"{type(error).__name__}: {error}")
"""
UNGUARDED = """
from svbrdfgan.utils.processes import worker_pool
with worker_pool(2, "thinks", "workers") as pool:
    pool.submit(len, "").result()
"""


@pytest.mark.skipif(os.name != "posix", reason="signals are those of POSIX")
@pytest.mark.parametrize("when", ["starting", pytest.param("busy", marks=pytest.mark.full)])
@pytest.mark.parametrize("to_all", [True, False], ids=["as a terminal", "as kill"])
def test_ctrl_c_ends_workers_without_tracebacks(when: str, to_all: bool) -> None:
    """The first or, 20 s later, the second does: Python may miss one that comes just before it waits for a lock."""
    process = subprocess.Popen(
        [sys.executable, "-c", POOL, when],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline().startswith("begun")

    def pressed() -> str:
        (os.killpg if to_all else os.kill)(process.pid, signal.SIGINT)
        return process.communicate(timeout=20)[1]  # ends when the workers have, too, which hold the same stderr

    try:
        said = pressed()
    except subprocess.TimeoutExpired:
        said = pressed()
    assert (process.returncode, said) == (130, "")


@pytest.mark.skipif(os.name != "posix", reason="signals are those of POSIX")
@pytest.mark.full
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_workers_end_with_their_parent(number: int, ended: Callable[[int], bool]) -> None:
    process = subprocess.Popen([sys.executable, "-c", POOL, "busy"], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    workers = list(map(int, process.stdout.readline().split()[1:]))
    assert len(workers) == 2
    process.send_signal(number)
    process.wait(timeout=60)
    assert all(map(ended, workers))


@pytest.mark.skipif(os.name != "posix", reason="signals are those of POSIX")
@pytest.mark.full
@pytest.mark.parametrize(
    ("number", "said"),
    [
        (signal.SIGKILL, "a process that sleeps was killed, probably for memory; try fewer --workers."),
        (
            signal.SIGSEGV,
            "a process that sleeps ended with signal 11: run the command again, with --workers 1 to see why.",
        ),
    ],
)
def test_how_a_worker_ended_is_told_at_once(number: int, said: str) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", POOL, "busy"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    os.kill(int(process.stdout.readline().split()[1]), number)
    began = time.monotonic()
    assert process.communicate(timeout=60)[1].strip() == f"AssetError: {said}"
    assert time.monotonic() - began < 10


@pytest.mark.full
def test_a_script_without_a_main_guard_is_told(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(UNGUARDED)
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    assert "Traceback" in done.stderr
    assert done.stderr.strip().endswith(
        'ConfigError: a script that asks for several workers needs its `if __name__ == "__main__":`.'
    )


@pytest.mark.skipif(os.name != "posix", reason="signals are those of POSIX")
def test_a_worker_that_ends_while_it_is_told_to_is_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    process = get_context("spawn").Process(target=len, args=("",))
    process.start()
    process.join()
    monkeypatch.setattr(type(process), "is_alive", lambda self: True)  # as it was a moment ago
    processes._end([process])
    assert process.exitcode == 0


@pytest.mark.skipif(os.name != "posix", reason="nothing is tracked")
def test_a_shared_count_outlives_a_kill_without_a_word() -> None:
    """Python's resource tracker ends later than the program, and keeps its stderr open until then."""
    code = "import os; from svbrdfgan.utils.processes import shared_count; c = shared_count(); os.kill(os.getpid(), 9)"
    done = subprocess.run([sys.executable, "-c", code], stderr=subprocess.PIPE, text=True)
    assert (done.returncode, done.stderr) == (-9, "")


@pytest.mark.skipif(os.name != "posix", reason="on Windows it lives on")
def test_a_process_without_a_group_of_its_own_ends_with_its_parent() -> None:
    child = (
        "import sys, time; from svbrdfgan.utils.processes import end_with_parent;"
        "end_with_parent(int(sys.argv[1])); print('started', flush=True); time.sleep(600)"
    )
    parent = f"import os, subprocess, sys; subprocess.run([sys.executable, '-c', {child!r}, str(os.getpid())])"
    with subprocess.Popen([sys.executable, "-c", parent], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "started\n"
        process.kill()
        assert process.stdout.read() == "", "the pipe closes when the child ends"
