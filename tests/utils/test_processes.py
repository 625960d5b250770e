"""Worker processes end without a word when Ctrl-C ends the command."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest

POOL = """
import os, sys, time
from svbrdfgan.utils.processes import worker_pool
try:
    with worker_pool(2, "sleeps", "--workers") as pool:
        if sys.argv[1] == "busy":
            pool.submit(os.getpid).result()
        sleeping = [pool.submit(time.sleep, 600) for _ in range(5)]
        print("begun", flush=True)
        sleeping[0].result()
except KeyboardInterrupt:
    sys.exit(130)
"""


@pytest.mark.skipif(os.name != "posix", reason="signals are those of POSIX")
@pytest.mark.parametrize("when", ["starting", pytest.param("busy", marks=pytest.mark.full)])
@pytest.mark.parametrize("to_all", [True, False], ids=["as a terminal", "as kill"])
def test_ctrl_c_ends_workers_without_tracebacks(when: str, to_all: bool) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", POOL, when],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "begun\n"
    began = time.monotonic()
    (os.killpg if to_all else os.kill)(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=60)  # ends when the workers have, too, which hold the same stderr
    assert (process.returncode, said) == (130, "")
    assert time.monotonic() - began < 30
