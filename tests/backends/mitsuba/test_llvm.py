"""A bad LLVM is rejected by one sentence before it is loaded; a good one is found."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from svbrdfgan_mitsuba import llvm

from svbrdfgan.errors import PluginError

FAKE = "void LLVMGetVersion(unsigned *a, unsigned *b, unsigned *c) { *a = 15; *b = 0; *c = 7; }"
MAKE = "from svbrdfgan_mitsuba import MitsubaRenderer; MitsubaRenderer('cpu')"


def process(code: str, library: object = None) -> subprocess.CompletedProcess[str]:
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    env.pop(llvm.VARIABLE, None)
    if library:
        env[llvm.VARIABLE] = str(library)
    return subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, timeout=300)


@pytest.fixture(scope="module")
def old_library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A library that says that it is LLVM 15."""
    if not (compiler := shutil.which("cc")):
        pytest.skip("there is no C compiler")
    folder = tmp_path_factory.mktemp("llvm")
    (folder / "fake.c").write_text(FAKE)
    library = folder / "libLLVM-15.so"
    subprocess.run([compiler, "-shared", "-fPIC", "-o", str(library), str(folder / "fake.c")], check=True)
    return library


def test_the_one_that_pip_brings_is_found() -> None:
    (*_, library) = llvm.installed_libraries()
    version = llvm.library_version(library)
    assert version is not None
    assert version >= llvm.LEAST
    assert llvm.choose_library(None) in set(llvm.installed_libraries())


@pytest.mark.full
def test_dr_jit_works_with_it_and_the_variable_is_not_left_set() -> None:
    done = process(
        f"import os; {MAKE}; print(os.environ.get({llvm.VARIABLE!r}), sys_version())".replace(
            "sys_version()", "__import__('svbrdfgan_mitsuba').llvm.loaded_version()"
        )
    )
    assert done.returncode == 0, done.stderr
    unset, version = done.stdout.split()
    assert unset == "None"
    assert int(version) >= llvm.LEAST


def test_an_old_library_is_refused_before_it_is_used(old_library: Path) -> None:
    assert llvm.library_version(old_library) == 15
    done = process(MAKE, old_library)
    assert done.returncode == 1
    assert "libLLVM-15.so', which is LLVM 15; wanted 19 or later" in done.stderr.splitlines()[-1]


@pytest.mark.full
def test_what_is_no_library_is_refused(tmp_path: Path) -> None:
    (tmp_path / "libLLVM.so").write_text("not at all")
    assert llvm.library_version(tmp_path / "libLLVM.so") is None
    assert llvm.library_version(tmp_path / "none") is None
    done = process(MAKE, tmp_path / "libLLVM.so")
    assert done.returncode == 1
    assert "which is no LLVM library; unset it" in done.stderr.splitlines()[-1]


def test_one_that_dr_jit_loaded_before_is_refused_if_it_is_too_old(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(llvm.VARIABLE, raising=False)
    for version, said in ((15, "LLVM 15"), (None, "no LLVM")):
        monkeypatch.setattr(llvm, "loaded_version", lambda version=version: version)
        with pytest.raises(PluginError, match=f"drjit was imported before and loaded {said}; wanted 19 or later"):
            llvm.require()


def test_what_the_user_wants_comes_first_and_is_checked() -> None:
    assert llvm.choose_library("/some/libLLVM.so", lambda _: 20) == Path("/some/libLLVM.so")
    with pytest.raises(PluginError, match="is LLVM 18; wanted 19 or later"):
        llvm.choose_library("/some/libLLVM.so", lambda _: 18)


def test_without_pip_s_the_machine_s_newest_is_taken(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(llvm, "installed_libraries", lambda: iter(()))
    versions = {tmp_path / f"libLLVM-{number}.so.1": number for number in (14, 20, 19)}
    for path in versions:
        path.touch()
    assert set(llvm.machine_libraries([str(tmp_path)])) == set(versions)
    monkeypatch.setattr(llvm, "machine_libraries", lambda: llvm.Path(tmp_path).glob("*"))
    assert llvm.choose_library(None, versions.get) == tmp_path / "libLLVM-20.so.1"
    with pytest.raises(PluginError, match="no LLVM of version 19 or later was found; pip install"):
        llvm.choose_library(None, lambda _: 16)
