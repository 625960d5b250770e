"""Reads files in worker processes and says what came of each: read, refused, or one of the ways to fail."""

from __future__ import annotations

import faulthandler
import logging
import multiprocessing
import os
import resource
import signal
import time
import traceback
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from svbrdfgan.errors import SvbrdfganError
from svbrdfgan.utils.printable import printable

SECONDS = 5.0
"""What a reader may compute."""
_BUSY = 4.0
"""How much longer it may take on the clock: the machine has other work."""
_LOOK_SECONDS = 0.25
BYTES = 1_000_000_000
"""Resident memory that a reader may take, over what its process had."""
SOUND = ("read", "refused")
"""Outcomes that are no failures."""

_ADDRESSES = 4 * BYTES  # more than that a reader cannot ask for, resident or not
_STATUS, _FORGET = Path("/proc/self/status"), Path("/proc/self/clear_refs")

Reader = Callable[[Path], Any]


@dataclass(frozen=True)
class Outcome:
    """What came of a file: `read`, `refused`, `wordless`, `traceback`, `memory`, `hang` or `killed`, and why."""

    name: str
    why: str = ""


class Judge:
    """Reads files by named readers, in a process that it starts again whenever it hangs or dies."""

    def __init__(self, readers: dict[str, Reader]) -> None:
        self.readers = readers
        self._worker: multiprocessing.process.BaseProcess | None = None
        self._pipe: Connection | None = None
        self._trace: Connection | None = None

    def judge(self, reader: str, path: Path, seconds: float = SECONDS) -> Outcome:
        """The outcome of reading a file that may take so many seconds of computing."""
        pipe = self._pipe if self._pipe is not None and self._alive() else self._start()
        pipe.send((reader, str(path)))
        began, until = self._computed(), time.monotonic() + _BUSY * seconds
        try:
            while time.monotonic() < until and self._computed() - began < seconds:
                if pipe.poll(_LOOK_SECONDS):
                    return Outcome(*pipe.recv())
        except (EOFError, ConnectionError):
            code = self._stop()
            return Outcome("killed", f"exit code {code}")
        where = self._place()
        self._stop()
        return Outcome("hang", f"more than {seconds:g} s at\n{where}")

    def close(self) -> None:
        """Ends the worker."""
        self._stop()

    def _alive(self) -> bool:
        return self._worker is not None and self._worker.is_alive()

    def _computed(self) -> float:
        """Seconds that the worker has computed."""
        assert self._worker is not None
        numbers = Path(f"/proc/{self._worker.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(numbers[11]) + int(numbers[12])) / os.sysconf("SC_CLK_TCK")

    def _place(self) -> str:
        """Where the worker is, the innermost call first."""
        assert self._worker is not None
        assert self._worker.pid is not None
        assert self._trace is not None
        os.kill(self._worker.pid, signal.SIGUSR1)
        time.sleep(_LOOK_SECONDS)
        return os.read(self._trace.fileno(), 1 << 16).decode() if self._trace.poll() else "an unknown place"

    def _start(self) -> Connection:
        context = multiprocessing.get_context("fork")  # a fork has all modules at once
        self._trace, places = context.Pipe(duplex=False)
        self._pipe, theirs = context.Pipe()
        self._worker = context.Process(target=_work, args=(theirs, places, self.readers), daemon=True)
        self._worker.start()
        theirs.close()
        return self._pipe

    def _stop(self) -> int | None:
        if self._worker is None:
            return None
        self._worker.join(0.5)
        if self._worker.is_alive():
            self._worker.kill()
            self._worker.join()
        code, self._worker, self._pipe = self._worker.exitcode, None, None
        return code


def _work(pipe: Connection, places: Connection, readers: dict[str, Reader]) -> None:
    faulthandler.register(signal.SIGUSR1, places.fileno())
    logging.disable()
    warnings.simplefilter("ignore")
    import torch

    torch.set_num_threads(1)
    with open(os.devnull, "w") as nowhere:  # libraries write their opinions there
        os.dup2(nowhere.fileno(), 1)
        os.dup2(nowhere.fileno(), 2)
    most = _status("VmSize") + _ADDRESSES
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    while True:
        reader, path = pipe.recv()
        pipe.send(_outcome(readers[reader], Path(path)))


def _outcome(reader: Reader, path: Path) -> tuple[str, str]:
    _FORGET.write_text("5")  # sets the peak to what is resident now
    before = _status("VmRSS")
    name, why = _tried(reader, path)
    taken = _status("VmHWM") - before
    return ("memory", f"{taken / 1e9:.1f} GB: {why}") if taken > BYTES else (name, why)


def _tried(reader: Reader, path: Path) -> tuple[str, str]:
    try:
        reader(path)
    except SvbrdfganError as error:
        message = printable(str(error), breaks=True)
        if "MemoryError" in message or "llocate" in message:
            return "memory", message
        return ("refused" if message.strip() else "wordless"), message
    except MemoryError:
        return "memory", traceback.format_exc()
    except Exception:
        return "traceback", traceback.format_exc()
    return "read", ""


def _status(name: str) -> int:
    """A number of Linux's about this process, in bytes."""
    return next(int(line.split()[1]) << 10 for line in _STATUS.read_text().splitlines() if line.startswith(f"{name}:"))
