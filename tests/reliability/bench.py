"""Starts commands as processes, disturbs them, and says what was wrong afterwards."""

from __future__ import annotations

import ctypes
import fcntl
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from uuid import uuid4

from tests.reliability.commands import Command, write_inputs

_MARK = "SVBRDFGAN_TEST_OF_RELIABILITY"
_STARTED = 0.3
"""Seconds after which Python itself has started: signals before then are not the program's."""
_LONG = 8.0
"""Seconds within which a command of minutes is disturbed."""
_GRACE = 2.0
"""Seconds after which no process may be left."""
_PATIENCE = 300.0
_DROP, _OVERRIDE = 24, 1  # PR_CAPBSET_DROP, CAP_DAC_OVERRIDE
_TORCH = "torchinductor_"
"""How the name of a folder begins that torch makes among temporary ones, and uses again."""
_NOT_OURS = ("Warp ", "  ")
"""How lines on stderr begin that Warp prints, and those of progress."""


@dataclass(frozen=True)
class Ended:
    """How a command ended; `said` are the lines on stderr that are sentences."""

    code: int | None
    said: list[str]
    seconds: float


@dataclass(frozen=True)
class Usual:
    """An undisturbed call: how long it took, and the sums of its results."""

    seconds: float
    results: dict[str, str]


@dataclass
class Bench:
    """A folder with the inputs, in which commands are tried, each in a folder of its own.

    Attributes:
        usual: what is known of undisturbed calls, by words.
    """

    folder: Path
    usual: dict[str, Usual] = field(default_factory=dict)

    @property
    def inputs(self) -> Path:
        return self.folder / "inputs"

    def prepare(self) -> None:
        """Makes all inputs."""
        self.inputs.mkdir(parents=True)
        write_inputs(self.inputs)
        for words in ("dataset dataset.yaml -o data", "train train.yaml -o run"):
            ended = run(words, self.inputs)
            assert ended.code == 0, ended

    def undisturbed(self, command: Command) -> Usual:
        if command.words not in self.usual:
            if command.long:
                self.usual[command.words] = Usual(_LONG, {})
            else:
                with self.place(command) as place:
                    ended = run(command.words, place)
                    assert ended.code == 0, ended
                    for pattern in command.results:
                        assert any(place.glob(pattern)), f"{command.words} leaves no {pattern}"
                    self.usual[command.words] = Usual(ended.seconds, results(command, place))
        return self.usual[command.words]

    @contextmanager
    def place(self, command: Command) -> Iterator[Path]:
        """A new folder with copies of what the command needs."""
        place = self.folder / uuid4().hex[:8]
        (place / "tmp").mkdir(parents=True)
        for name in command.needs:
            copy = shutil.copytree if (self.inputs / name).is_dir() else shutil.copyfile
            copy(self.inputs / name, place / name)
        try:
            yield place
        finally:
            shutil.rmtree(place, ignore_errors=True)

    def by_signal(self, command: Command, number: signal.Signals, moment: float) -> list[str]:
        """Tells a command to stop, after this share of the time that it takes; Ctrl-C reaches its workers, too."""
        usual = self.undisturbed(command)
        wait = _STARTED + moment * max(0.0, usual.seconds - _STARTED)

        def disturb(process: subprocess.Popen[str]) -> None:
            (os.killpg if number == signal.SIGINT else os.kill)(process.pid, number)

        with self.place(command) as place:
            ended, troubles = watch(command.words, place, wait, disturb)
            fine = {0, -number} if number == signal.SIGKILL else {0, 128 + number, -number}
            troubles += [] if ended.code in fine else [f"exit code {ended.code}"]
            if ended.code == -number and ended.said:
                troubles.append(f"it was killed and spoke: {ended.said}")
            troubles += too_much(ended, 1)
            return [f"after {wait:.1f} s: {each}" for each in troubles + self.goes_on(command, place)]

    def on_full_disk(self, command: Command, most: int) -> list[str]:
        """Lets no file become larger than so many bytes."""
        with self.place(command) as place:
            ended, troubles = watch(
                command.words, place, prepare=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))
            )
            if not (ended.code == 0 and all(path.stat().st_size <= most for path in _files(command, place))):
                troubles += refused(ended, ("File too large", "cannot be written", "No usable temporary directory"))
            return [f"{most} bytes: {each}" for each in troubles + self.goes_on(command, place)]

    def in_read_only_folder(self, command: Command) -> list[str]:
        """Takes the right to write into the folder that the command writes into."""
        with self.place(command) as place:
            folder = place / command.writes
            folder.mkdir(exist_ok=True)
            entries = [folder, *(path for path in folder.rglob("*") if path.is_dir())]
            for each in entries:
                each.chmod(0o555)
            ended, troubles = watch(command.words, place, prepare=_obey_permissions)
            for each in entries:
                each.chmod(0o755)
            return (
                troubles + refused(ended, ("Permission denied", "may not be written to")) + self.goes_on(command, place)
            )

    def two_at_once(self, command: Command) -> list[str]:
        """Starts a second call while a first one works."""
        usual = self.undisturbed(command)
        with self.place(command) as place:
            second: list[Ended] = []

            def disturb(process: subprocess.Popen[str]) -> None:
                until = time.monotonic() + _PATIENCE
                while process.poll() is None and time.monotonic() < until and not _is_claimed(place / command.claims):
                    time.sleep(0.01)
                process.send_signal(signal.SIGSTOP)  # else it may have ended before the other has begun
                second.append(run(command.again or command.words, place))
                process.send_signal(signal.SIGCONT)

            first, troubles = watch(command.words, place, 0.0, disturb)
            troubles += [] if first.code == 0 else [f"the first ended with {first}"]
            troubles += refused(second[0], ("by another process; wait until it has ended.",))
            if not command.long and results(command, place) != usual.results:
                troubles.append("the first has other results")
            return troubles

    def goes_on(self, command: Command, place: Path) -> list[str]:
        """Calls it once more: it must complete, with the results of an undisturbed call and nothing besides."""
        if command.long:
            return []
        usual, ended = self.undisturbed(command), run(command.again or command.words, place)
        if ended.code != 0:
            return [f"the next call ended with {ended}"]
        found = results(command, place)
        differing = sorted(name for name in {*found, *usual.results} if found.get(name) != usual.results.get(name))
        left = [str(path.relative_to(place)) for path in place.rglob("*") if path.name.startswith(".")]
        left += [f"tmp/{path.name}" for path in (place / "tmp").iterdir() if not path.name.startswith(_TORCH)]
        return [f"{name} is not as usual" for name in differing] + [f"{name} was left" for name in left]


def run(words: str, place: Path) -> Ended:
    """Calls a command and waits."""
    return watch(words, place)[0]


def watch(
    words: str,
    place: Path,
    wait: float | None = None,
    disturb: Callable[[subprocess.Popen[str]], None] = lambda process: None,
    prepare: Callable[[], None] | None = None,
) -> tuple[Ended, list[str]]:
    """Calls a command, disturbs it after some seconds unless it has ended, and finds the processes that outlive it."""
    mark, began = uuid4().hex, time.monotonic()
    (place / "tmp").mkdir(exist_ok=True)
    process = subprocess.Popen(
        [sys.executable, "-m", "svbrdfgan", "--quiet", *words.split()],
        cwd=place,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        env=os.environ
        | {_MARK: mark, "TMPDIR": str(place / "tmp"), "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        start_new_session=True,
        preexec_fn=prepare,
    )
    if wait is not None:
        try:
            process.wait(wait)
        except subprocess.TimeoutExpired:
            disturb(process)
    try:
        said, troubles = process.communicate(timeout=_PATIENCE)[1], []
    except subprocess.TimeoutExpired:
        said, troubles = "", [f"it went on, or someone who had its stderr, for {_PATIENCE:g} s"]
    seconds, until = time.monotonic() - began, time.monotonic() + _GRACE
    while (left := _alive(mark)) and time.monotonic() < until:
        time.sleep(0.05)
    for pid, name in left.items():
        troubles.append(f"a process was left: {name}")
        os.kill(pid, signal.SIGKILL)
    lines = [line for line in said.splitlines() if line.strip() and not line.startswith(_NOT_OURS)]
    lines = said.splitlines() if "Traceback" in said else lines
    return Ended(process.poll(), lines, seconds), troubles


def too_much(ended: Ended, most: int) -> list[str]:
    """What is wrong with what was said."""
    return [] if len(ended.said) <= most else [f"it said {len(ended.said)} lines: " + " | ".join(ended.said)[-1500:]]


def refused(ended: Ended, reasons: tuple[str, ...]) -> list[str]:
    """What is wrong with a call that should have ended with one sentence."""
    fine = ended.code == 1 and len(ended.said) == 1 and any(reason in ended.said[0] for reason in reasons)
    return [] if fine else [f"exit code {ended.code}: " + " | ".join(ended.said)[-1500:]]


def results(command: Command, place: Path) -> dict[str, str]:
    """The sum of each file that is a result."""
    return {str(path.relative_to(place)): sha256(_ordered(path)).hexdigest() for path in _files(command, place)}


def _files(command: Command, place: Path) -> list[Path]:
    """The files that are results."""
    return sorted({path for pattern in command.results for path in place.glob(pattern) if path.is_file()})


def _ordered(path: Path) -> bytes:
    """The bytes of a file; of safetensors with a sorted header, since that library writes words in any order."""
    data = path.read_bytes()
    if path.suffix != ".safetensors":
        return data
    end = 8 + int.from_bytes(data[:8], "little")
    return json.dumps(json.loads(data[8:end]), sort_keys=True).encode() + data[end:]


def _alive(mark: str) -> dict[int, str]:
    """The processes that were started with the mark and run: number and command line."""
    found = {}
    for path in Path("/proc").glob("[0-9]*/environ"):
        try:
            marked = f"{_MARK}={mark}".encode() in path.read_bytes().split(b"\0")
            running = path.with_name("stat").read_text().rpartition(")")[2].split()[0] != "Z"
            if marked and running:
                found[int(path.parent.name)] = path.with_name("cmdline").read_text().replace("\0", " ")[:200]
        except OSError:
            continue
    return found


def _is_claimed(path: Path) -> bool:
    if not path.exists():
        return False
    handle = os.open(path, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(handle)
    return False


def _obey_permissions() -> None:
    """Takes from root the right to ignore permissions; others obey them anyway."""
    if os.geteuid() == 0 and ctypes.CDLL(None, use_errno=True).prctl(_DROP, _OVERRIDE, 0, 0, 0):
        raise OSError(ctypes.get_errno(), "root cannot be made to obey permissions")
