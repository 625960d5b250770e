"""Tries whether plugins work here, each in its own process, since a bad driver can abort or hang a process.

`python -m svbrdfgan.plugins.probe PARENT GROUP NAME DEVICE RESULT` is that process. It writes JSON to the file RESULT,
because plugins may print to stdout.
"""

from __future__ import annotations

import dataclasses
import inspect
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Literal

from svbrdfgan.config.models import default_options
from svbrdfgan.errors import SvbrdfganError
from svbrdfgan.plugins.registry import RENDERERS, MissingDependencyError, Plugin, find_plugin, import_factory, make
from svbrdfgan.utils.leftovers import scratch_folder
from svbrdfgan.utils.processes import end_with_parent, import_path

TIMEOUT_SECONDS = 120.0


@dataclass(frozen=True)
class Probe:
    """Whether a plugin works, and what it can do.

    Attributes:
        reason: why it is not ok, in one sentence; None if it is.
        capabilities: its capability record as JSON values, sets as sorted lists; None unless it is ok.
        device: type of a renderer's device, such as "cpu"; None for embeddings.
        options: options with which it was tried.
        defaults: all options that it takes, with their defaults as JSON values.
    """

    status: Literal["ok", "missing", "broken"]
    reason: str | None = None
    capabilities: Mapping[str, Any] | None = None
    device: str | None = None
    options: Mapping[str, object] = dataclasses.field(default_factory=dict)
    defaults: Mapping[str, object] = dataclasses.field(default_factory=dict)


def probe(plugin: Plugin, device: str | None = None, timeout: float = TIMEOUT_SECONDS) -> Probe:
    """Tries the plugin with its default options, on `device` if one is given. Takes as long as importing it."""
    return probe_all([plugin], device, timeout)[0]


def probe_all(
    plugins: Iterable[Plugin], device: str | None = None, timeout: float = TIMEOUT_SECONDS
) -> tuple[Probe, ...]:
    """The probes of all plugins, tried at once; each has `timeout` seconds."""
    deadline = time.monotonic() + timeout
    with scratch_folder() as folder, ExitStack() as stack:
        trials = [
            Probe("broken", plugin.problem)
            if plugin.problem
            else stack.enter_context(_trial(plugin, device, folder / f"{number}.json"))
            for number, plugin in enumerate(plugins)
        ]
        return tuple(trial if isinstance(trial, Probe) else trial.outcome(deadline, timeout) for trial in trials)


@dataclass(frozen=True)
class _Trial:
    plugin: Plugin
    process: subprocess.Popen[bytes]
    result: Path
    errors: IO[bytes]

    def outcome(self, deadline: float, timeout: float) -> Probe:
        try:
            code = self.process.wait(max(0.0, deadline - time.monotonic()))
        except subprocess.TimeoutExpired:
            code = None
        if self.result.exists():
            return Probe(**json.loads(self.result.read_text(encoding="utf-8")))
        if code is None:
            return Probe("broken", f"{self.plugin.title} did not answer within {timeout:g} s.")
        self.errors.seek(0)
        said = self.errors.read().decode("utf-8", errors="replace").strip().splitlines()
        last_words = f" Its last words: {said[-1].strip()}" if said else ""
        return Probe("broken", f"{self.plugin.title} ended its process: {_ending(code)}.{last_words}")


@contextmanager
def _trial(plugin: Plugin, device: str | None, result: Path) -> Iterator[_Trial]:
    told = [str(os.getpid()), plugin.group, plugin.name, device or "", str(result)]
    with tempfile.TemporaryFile() as errors:
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", __name__, *told],
            env={**os.environ, "PYTHONPATH": import_path()},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=errors,
            start_new_session=True,
        )
        try:
            yield _Trial(plugin, process, result, errors)
        finally:
            _end(process)


def _end(process: subprocess.Popen[bytes]) -> None:
    """Kills the process, and on POSIX its children."""
    if os.name == "posix":
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
    process.kill()
    process.wait()


def _ending(code: int) -> str:
    try:
        return signal.Signals(-code).name if code < 0 else f"exit code {code}"
    except ValueError:
        return f"signal {-code}"


def _examine(plugin: Plugin, device: str) -> Probe:
    factory = import_factory(plugin)
    options = {"device": device} if device and "device" in inspect.signature(factory).parameters else {}
    try:
        made: Any = make(plugin, options)
    except MissingDependencyError as error:
        return Probe("missing", str(error))
    found = made.device.type if plugin.group == RENDERERS else None
    if device and found != device:
        return Probe("broken", f"{plugin.title} runs on {found}, not on {device}.")
    return Probe("ok", None, _plain(made.capabilities), found, options, default_options(factory))


def _plain(record: Any) -> dict[str, Any]:
    fields = dataclasses.asdict(record).items()
    return {name: sorted(value) if isinstance(value, (set, frozenset)) else value for name, value in fields}


def _main(parent: str, group: str, name: str, device: str, result: str) -> None:
    end_with_parent(int(parent))
    try:
        outcome = _examine(find_plugin(group, name), device)
    except MissingDependencyError as error:
        outcome = Probe("missing", str(error))
    except SvbrdfganError as error:
        outcome = Probe("broken", str(error))
    partial = Path(result + ".partial")
    partial.write_text(json.dumps(dataclasses.asdict(outcome), default=str), encoding="utf-8")
    partial.replace(result)


if __name__ == "__main__":
    _main(*sys.argv[1:])
