"""Signals stop a command, and are not lost where nothing can be raised."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from svbrdfgan.utils.processes import import_path
from svbrdfgan.utils.stopping import stopped_by_signals

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals are those of POSIX")

LOST = """
import os, signal, sys, time
from svbrdfgan.utils.stopping import end_by_signals, exit_code, stopped_by_signals

class Stubborn:
    def __del__(self):
        os.kill(os.getpid(), int(sys.argv[1]))
        time.sleep(1)

end_by_signals()
try:
    with stopped_by_signals():
        Stubborn()
        time.sleep(30)
except KeyboardInterrupt as stopped:
    print(exit_code(stopped))
os.kill(os.getpid(), int(sys.argv[1]))
time.sleep(30)
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_in_a_destructor_is_raised_again_and_outside_of_a_command_it_ends_the_process(number: int) -> None:
    code = [sys.executable, "-u", "-c", LOST, str(int(number))]
    ended = subprocess.run(code, capture_output=True, text=True, timeout=25)
    assert (ended.returncode, ended.stdout, ended.stderr) == (-number, f"{128 + number}\n", "")


ENDING = """
import os, signal, time
from svbrdfgan.utils.stopping import end_by_signals, exit_code, stopped_by_signals

class Stubborn:
    def __del__(self):
        raise KeyboardInterrupt

end_by_signals()
try:
    with stopped_by_signals():
        Stubborn()
        os.kill(os.getpid(), signal.SIGTERM)
except KeyboardInterrupt as stopped:
    time.sleep(0.3)
    print(exit_code(stopped))
"""


def test_what_was_lost_does_not_end_a_process_that_is_stopping() -> None:
    ended = subprocess.run([sys.executable, "-c", ENDING], capture_output=True, text=True, timeout=25)
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "143\n", "")


RACING = """
import os, signal, sys, time
from svbrdfgan.utils.stopping import end_by_signals, exit_code, stopped_by_signals

kill = signal.pthread_kill

def slow(thread, number):
    sys.stdout.write("sent\\n")
    time.sleep(0.5)
    kill(thread, number)

signal.pthread_kill = slow

class Stubborn:
    def __del__(self):
        raise KeyboardInterrupt

end_by_signals()
try:
    with stopped_by_signals():
        Stubborn()
        time.sleep(0.2)
except KeyboardInterrupt as stopped:
    print(exit_code(stopped))
time.sleep(1)
"""


def test_what_is_sent_while_a_command_ends_does_not_end_the_process() -> None:
    ended = subprocess.run([sys.executable, "-c", RACING], capture_output=True, text=True, timeout=25)
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "sent\n130\n", "")


SWALLOWING = """
import os, signal, time
try:
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(0.3)
except BaseException:
    pass
"""

IMPORTING = """
import time
from svbrdfgan.utils.stopping import exit_code, stopped_by_signals

try:
    with stopped_by_signals():
        import swallowing
        time.sleep(30)
except KeyboardInterrupt as stopped:
    raise SystemExit(exit_code(stopped))
"""

WITHIN_TEXT = """
from svbrdfgan.utils.stopping import end_by_signals, exit_code, stopped_by_signals

end_by_signals()
try:
    with stopped_by_signals():
        exec("import os, signal; os.kill(os.getpid(), signal.SIGTERM)")
except KeyboardInterrupt as stopped:
    raise SystemExit(exit_code(stopped))
"""


@pytest.mark.parametrize("text", [IMPORTING, WITHIN_TEXT])
def test_a_signal_within_an_import_or_within_text_that_is_executed_stops_as_elsewhere(
    text: str, tmp_path: Path
) -> None:
    (tmp_path / "swallowing.py").write_text(SWALLOWING)
    (tmp_path / "program.py").write_text(text)
    path = os.pathsep.join([str(tmp_path), import_path()])
    ended = subprocess.run(
        [sys.executable, "-m", "program"],
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
        timeout=25,
    )
    assert (ended.returncode, ended.stderr) == (143, "")


def test_handlers_of_others_are_left_alone() -> None:
    before, hook = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)], sys.unraisablehook
    with stopped_by_signals():
        assert signal.getsignal(signal.SIGINT) is before[0]
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)] == before
    assert sys.unraisablehook is hook
