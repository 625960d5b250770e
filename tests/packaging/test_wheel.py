"""The wheel holds what is needed and no more, and its entry points are found where it is installed."""

import os
import re
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from pathlib import Path

import pytest

from svbrdfgan import __version__

REPOSITORY = Path(__file__).parents[2]
PACKAGES = {
    path.parent.name
    for place in ("backends", "parameterizations")
    for path in REPOSITORY.glob(f"{place}/*/__init__.py")
}
METADATA = f"svbrdfgan-{__version__}.dist-info"
STRAY = ("backends", "tests", "parameterizations", "docs", "examples", "benchmarks")


def run(site: Path, code: str) -> list[str]:
    """The words that the code prints, where the wheel is installed beside the dependencies, without the sources."""
    path = os.pathsep.join([str(site), sysconfig.get_path("purelib"), sysconfig.get_path("platlib")])
    command = [sys.executable, "-S", "-P", "-c", code]
    done = subprocess.run(command, env={**os.environ, "PYTHONPATH": path}, cwd=site, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


@pytest.mark.full
def test_what_is_in_the_wheel(wheel: Path) -> None:
    names = zipfile.ZipFile(wheel).namelist()
    tops = {name.split("/")[0] for name in names}
    assert tops == {"svbrdfgan", METADATA, *PACKAGES}
    assert "svbrdfgan/py.typed" in names
    models = {path.relative_to(REPOSITORY).as_posix() for path in (REPOSITORY / "svbrdfgan" / "models").glob("*/*.*")}
    assert {name for name in models if "__pycache__" not in name} <= set(names)
    assert wheel.stat().st_size < 40_000_000
    licence = zipfile.ZipFile(wheel).read(f"{METADATA}/licenses/LICENSE")
    assert b"Apache License" in licence


@pytest.mark.full
def test_the_page_on_pypi_leads_to_the_repository(wheel: Path) -> None:
    text = zipfile.ZipFile(wheel).read(f"{METADATA}/METADATA").decode()
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    targets = re.findall(r"\]\(([^)\s]+)", text)
    assert len(targets) > 20
    assert [target for target in targets if not target.startswith(("https://", "#"))] == []
    pictures = re.findall(r"!\[[^\]]*\]\((\S+?)\)", text)
    assert pictures
    assert all(picture.startswith(f"{project['urls']['Repository']}/raw/HEAD/") for picture in pictures)


def test_every_package_is_declared() -> None:
    declared = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["tool"]["hatch"]["build"]["targets"]["wheel"]
    assert {Path(path).name for path in declared["packages"]} == {"svbrdfgan", *PACKAGES}


def test_the_citation_names_this_version() -> None:
    assert f"\nversion: {__version__}\n" in (REPOSITORY / "CITATION.cff").read_text()


@pytest.mark.full
def test_entry_points_are_found(site: Path) -> None:
    code = (
        "import svbrdfgan; from svbrdfgan.plugins.registry import *\n"
        "plugins = [*list_plugins(RENDERERS), *list_plugins(EMBEDDINGS)]\n"
        "print(svbrdfgan.__file__, *(plugin.name for plugin in plugins if not plugin.problem))"
    )
    file, *names = run(site, code)
    assert Path(file).is_relative_to(site)
    assert {"numpy", "warp", "hemispherical"} <= set(names)


@pytest.mark.full
def test_the_chosen_plugin_comes_from_the_wheel(site: Path) -> None:
    code = (
        "import inspect; from svbrdfgan.plugins.registry import load_embedding; "
        "print(inspect.getfile(type(load_embedding('hemispherical'))))"
    )
    assert Path(run(site, code)[0]).is_relative_to(site)


@pytest.mark.full
def test_no_stray_package_is_importable(site: Path) -> None:
    code = f"import importlib.util as u; print(*(name for name in {STRAY} if u.find_spec(name)))"
    assert run(site, code) == []


def test_no_stray_package_is_importable_from_the_installation_under_test(tmp_path: Path) -> None:
    code = f"import importlib.util as u; print(*(name for name in {STRAY} if u.find_spec(name)))"
    done = subprocess.run([sys.executable, "-P", "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.split() == []
