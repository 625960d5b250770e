"""The LLVM that compiles Dr.Jit's kernels for the CPU.

Dr.Jit loads one when it is first imported, and a bad one ends the process while it compiles. So it is chosen, and its
version read, before that.
"""

from __future__ import annotations

import importlib
import importlib.metadata
import os
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from svbrdfgan.errors import PluginError

LEAST = 19
"""On a CPU with AVX-512, 15 and 16 end the process ("Cannot select: fminimum"); 23 works, and 19 is said to. Those in
between were not tried."""

VARIABLE = "DRJIT_LIBLLVM_PATH"
_ADVICE = "pip install 'svbrdfgan[mitsuba]' brings one, which is found by itself"
_PLACES = ("/usr/lib", "/usr/lib64", "/usr/local/lib", "/usr/local/opt/llvm/lib", "/opt/homebrew/opt/llvm/lib")
_ASK = """import ctypes, sys
numbers = [ctypes.c_uint() for _ in range(3)]
ctypes.CDLL(sys.argv[1]).LLVMGetVersion(*map(ctypes.byref, numbers))
print(numbers[0].value)"""

Version = Callable[[Path], int | None]


def import_drjit() -> Any:
    """Dr.Jit; if this is its first import, with the library that `choose` finds, or else with none."""
    if "drjit" in sys.modules:
        return importlib.import_module("drjit")
    try:
        path = choose(os.environ.get(VARIABLE))
    except PluginError:
        path = Path(os.devnull)  # `require` will say why
    with _variable(path):
        return importlib.import_module("drjit")


def require() -> None:
    """Refuse to work with the LLVM that Dr.Jit has loaded if it is none or too old.

    Raises:
        PluginError: and what to do.
    """
    version = loaded_version()
    if version is None or version < LEAST:
        choose(os.environ.get(VARIABLE))
        raise PluginError(_came_late(version))


def choose(wanted: str | None, version: Version | None = None) -> Path:
    """The library that the user wants, else that of `karellen-llvm-core`, else the machine's newest.

    Raises:
        PluginError: what the user wants is not good enough, or nothing is.
    """
    version = version or library_version
    if wanted:
        return _checked(Path(wanted), version(Path(wanted)))
    found = next(installed_libraries(), None) or _newest(machine_libraries(), version)
    if found is None:
        raise PluginError(f"mitsuba renderer: no LLVM of version {LEAST} or later was found; {_ADVICE}.")
    return found


def loaded_version() -> int | None:
    """The major version of the LLVM that Dr.Jit has loaded; None if it could load none."""
    dr = importlib.import_module("drjit")
    if not dr.has_backend(dr.JitBackend.LLVM):
        return None
    return int(dr.detail.llvm_version()[0])


def library_version(path: Path) -> int | None:
    """The major version of an LLVM library; None if it is none. Read in another process, where it can do no harm."""
    command = [sys.executable, "-I", "-S", "-c", _ASK, str(path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60.0, check=False)
    return int(done.stdout) if done.returncode == 0 else None


def installed_libraries() -> Iterator[Path]:
    """Those of the package that svbrdfgan[mitsuba] requires."""
    try:
        files = importlib.metadata.files("karellen-llvm-core") or []
    except importlib.metadata.PackageNotFoundError:
        return
    for file in files:
        path = Path(str(file.locate()))
        if path.name.startswith(("libLLVM.", "libLLVM-", "LLVM-C.")) and path.exists():
            yield path.resolve()


def machine_libraries(places: Iterable[str] = _PLACES) -> Iterator[Path]:
    """Those of the operating system, each once."""
    patterns = ("libLLVM*.so*", "*/libLLVM*.so*", "llvm*/lib*/libLLVM*.so*", "libLLVM*.dylib")
    yield from dict.fromkeys(p.resolve() for place in places for pattern in patterns for p in Path(place).glob(pattern))


def _came_late(version: int | None) -> str:
    holds = "no LLVM" if version is None else f"LLVM {version}"
    return (
        f"mitsuba renderer: drjit was imported before and loaded {holds}; wanted {LEAST} or later, since older ones "
        f"can end the process: import svbrdfgan_mitsuba before drjit, or set {VARIABLE} before Python starts."
    )


def _newest(paths: Iterable[Path], version: Version) -> Path | None:
    versions = {path: version(path) or 0 for path in paths}
    best = max(versions, key=lambda path: versions[path], default=None)
    return best if best is not None and versions[best] >= LEAST else None


def _checked(path: Path, version: int | None) -> Path:
    if version is None:
        raise PluginError(
            f"mitsuba renderer: {VARIABLE} is {str(path)!r}, which is no LLVM library; unset it ({_ADVICE})."
        )
    if version < LEAST:
        raise PluginError(
            f"mitsuba renderer: {VARIABLE} is {str(path)!r}, which is LLVM {version}; wanted {LEAST} or later, since "
            f"older ones can end the process: unset it ({_ADVICE})."
        )
    return path


@contextmanager
def _variable(path: Path) -> Iterator[None]:
    before = os.environ.get(VARIABLE)
    os.environ[VARIABLE] = str(path)
    try:
        yield
    finally:
        if before is None:
            del os.environ[VARIABLE]
        else:
            os.environ[VARIABLE] = before
