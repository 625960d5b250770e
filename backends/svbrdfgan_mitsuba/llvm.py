"""The LLVM that compiles Dr.Jit's kernels for the CPU.

Dr.Jit loads LLVM when it is first imported, and a bad one aborts the process at the first compilation, which cannot be
caught. So the library is chosen, and its version read, before that import. The module itself must not import drjit.
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
"""Least major version. On a CPU with AVX-512, 15 and 16 abort the process ("Cannot select: fminimum"); 23 works, and 19
is reported to. The versions in between were not tried."""

VARIABLE = "DRJIT_LIBLLVM_PATH"
_ADVICE = "pip install 'svbrdfgan[mitsuba]' brings one, which is found automatically"
_PLACES = ("/usr/lib", "/usr/lib64", "/usr/local/lib", "/usr/local/opt/llvm/lib", "/opt/homebrew/opt/llvm/lib")
_ASK = """import ctypes, sys
numbers = [ctypes.c_uint() for _ in range(3)]
ctypes.CDLL(sys.argv[1]).LLVMGetVersion(*map(ctypes.byref, numbers))
print(numbers[0].value)"""

Version = Callable[[Path], int | None]


def import_drjit() -> Any:
    """Dr.Jit; if this is its first import, with the library that `choose_library` finds, or with none."""
    if "drjit" in sys.modules:
        return importlib.import_module("drjit")
    try:
        path = choose_library(os.environ.get(VARIABLE))
    except PluginError:
        path = Path(os.devnull)  # `require` raises with the reason
    with _variable(path):
        return importlib.import_module("drjit")


def require() -> None:
    """Checks the LLVM that Dr.Jit has loaded.

    Raises:
        PluginError: it loaded none, or one that is too old.
    """
    version = loaded_version()
    if version is None or version < LEAST:
        choose_library(os.environ.get(VARIABLE))  # raises if the library itself is the reason
        raise PluginError(_late_message(version))


def choose_library(wanted: str | None, version: Version | None = None) -> Path:
    """The library that the user names, else that of `karellen-llvm-core`, else the system's newest.

    Raises:
        PluginError: the named library is unusable or too old, or none was found.
    """
    version = version or library_version
    if wanted:
        return _checked(Path(wanted), version(Path(wanted)))
    found = next(installed_libraries(), None) or _newest(machine_libraries(), version)
    if found is None:
        raise PluginError(f"mitsuba renderer: no LLVM of version {LEAST} or later was found; {_ADVICE}.")
    return found


def loaded_version() -> int | None:
    """The major version of the LLVM that Dr.Jit has loaded; None if it has loaded none."""
    dr = importlib.import_module("drjit")
    if not dr.has_backend(dr.JitBackend.LLVM):
        return None
    return int(dr.detail.llvm_version()[0])


def library_version(path: Path) -> int | None:
    """The major version of an LLVM library; None if it is none. Read in another process, which it cannot harm."""
    command = [sys.executable, "-I", "-S", "-c", _ASK, str(path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60.0, check=False)
    return int(done.stdout) if done.returncode == 0 else None


def installed_libraries() -> Iterator[Path]:
    """The LLVM libraries of the package that svbrdfgan[mitsuba] requires."""
    try:
        files = importlib.metadata.files("karellen-llvm-core") or []
    except importlib.metadata.PackageNotFoundError:
        return
    for file in files:
        path = Path(str(file.locate()))
        if path.name.startswith(("libLLVM.", "libLLVM-", "LLVM-C.")) and path.exists():
            yield path.resolve()


def machine_libraries(places: Iterable[str] = _PLACES) -> Iterator[Path]:
    """The LLVM libraries of the operating system, each once."""
    patterns = ("libLLVM*.so*", "*/libLLVM*.so*", "llvm*/lib*/libLLVM*.so*", "libLLVM*.dylib")
    yield from dict.fromkeys(p.resolve() for place in places for pattern in patterns for p in Path(place).glob(pattern))


def _late_message(version: int | None) -> str:
    loaded = "no LLVM" if version is None else f"LLVM {version}"
    return (
        f"mitsuba renderer: drjit was imported before and loaded {loaded}; wanted {LEAST} or later, since older ones "
        f"can abort the process: import svbrdfgan_mitsuba before drjit, or set {VARIABLE} before Python starts."
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
            f"older ones can abort the process: unset it ({_ADVICE})."
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
