"""Wheels, built once, and a folder to install them in."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[2]
_IGNORED = shutil.ignore_patterns(".*", "__pycache__", "out", "runs", "dist", "build", "*.egg-info")


@pytest.fixture(scope="session")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of svbrdfgan, made from a copy of the sources alone."""
    folder = tmp_path_factory.mktemp("wheel")
    shutil.copytree(REPOSITORY, folder / "source", ignore=_IGNORED)
    shutil.copy(REPOSITORY / ".gitignore", folder / "source")
    return _built(folder)  # from the sdist


@pytest.fixture(scope="session")
def example_wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of the plugin in `examples/plugin`, likewise."""
    folder = tmp_path_factory.mktemp("example")
    shutil.copytree(REPOSITORY / "examples" / "plugin", folder / "source", ignore=_IGNORED)
    return _built(folder)


@pytest.fixture(scope="session")
def site(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the wheel of svbrdfgan alone, as pip installs it. Not to be changed."""
    return _installed(tmp_path_factory.mktemp("site"), wheel)


@pytest.fixture(scope="session")
def site_with_example(wheel: Path, example_wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with both. Not to be changed."""
    return _installed(tmp_path_factory.mktemp("both"), wheel, example_wheel)


def _built(folder: Path) -> Path:
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(folder), str(folder / "source")]
    subprocess.run(command, check=True, capture_output=True)
    return next(folder.glob("*.whl"))


def _installed(folder: Path, *wheels: Path) -> Path:
    command = [sys.executable, "-m", "pip", "install", "--no-deps", "--no-index", "--quiet", "--target", str(folder)]
    subprocess.run([*command, *map(str, wheels)], check=True, capture_output=True)
    return folder
