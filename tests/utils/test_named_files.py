"""What would be waited for without end is refused before it is opened."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from svbrdfgan.config.yaml_files import load_yaml
from svbrdfgan.errors import AssetError, ConfigError
from svbrdfgan.io.files import check_file
from svbrdfgan.io.records import load_json
from svbrdfgan.utils import named_files
from svbrdfgan.utils.named_files import expanded, read_text


@pytest.fixture
def pipe(tmp_path: Path) -> Path:
    os.mkfifo(tmp_path / "pipe.yaml")
    return tmp_path / "pipe.yaml"


def test_a_pipe_is_refused_by_every_reader_of_text(pipe: Path) -> None:
    with pytest.raises(ConfigError, match=r"pipe\.yaml: cannot be read: it is not a regular file"):
        load_yaml(pipe)
    with pytest.raises(AssetError, match=r"pipe\.yaml cannot be read: it is not a regular file"):
        load_json(pipe)
    with pytest.raises(AssetError, match=r"pipe\.yaml is not a regular file; wanted a mesh file"):
        check_file(pipe, (".yaml",), "mesh")


def test_a_device_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"/dev/zero: cannot be read: it is not a regular file"):
        load_yaml(Path("/dev/zero"))


def test_a_folder_and_a_missing_file_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be read: it is a folder"):
        load_yaml(tmp_path)
    with pytest.raises(ConfigError, match="cannot be read: No such file"):
        load_yaml(tmp_path / "none.yaml")


def test_a_long_file_is_refused_whatever_it_says_of_its_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(named_files, "MOST_TEXT", 2_000_000)
    (tmp_path / "long.yaml").write_text("a: " + "x" * 1_999_997)
    assert len(read_text(tmp_path / "long.yaml")) == 2_000_000
    (tmp_path / "long.yaml").write_text("a: " + "x" * 1_999_998)
    with pytest.raises(ConfigError, match=r"long\.yaml: cannot be read: it has more than 2 MB"):
        load_yaml(tmp_path / "long.yaml")


def test_users_that_there_are_not_have_no_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", "/somewhere")
    assert expanded("~/cars") == Path("/somewhere/cars")
    assert expanded("~nobody-of-this-name/cars") == Path("~nobody-of-this-name/cars")
