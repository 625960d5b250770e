"""A second process is refused what a first one works on."""

import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest

from svbrdfgan.errors import AssetError
from svbrdfgan.io.claims import claimed, claimed_folder

HOLD = """
import sys, time
from pathlib import Path
from svbrdfgan.io.claims import claimed_folder
with claimed_folder(Path(sys.argv[1])):
    print("mine", flush=True)
    time.sleep(60)
"""


def test_a_second_process_is_refused_until_the_first_is_gone(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "data"
    with subprocess.Popen([sys.executable, "-c", HOLD, str(folder)], stdout=subprocess.PIPE, text=True) as first:
        assert first.stdout is not None
        assert first.stdout.readline() == "mine\n"
        with pytest.raises(AssetError, match="is being written by another process; wait until"), claimed_folder(folder):
            raise AssertionError
        first.kill()
    with claimed_folder(folder):
        (folder / "a").touch()
    assert list(folder.iterdir()) == [folder / "a"]


def test_a_folder_that_stays_empty_is_removed_with_those_that_were_made_for_it(tmp_path: Path) -> None:
    (tmp_path / "old").mkdir()
    for folder in (tmp_path / "old", tmp_path / "new" / "data"):
        with claimed_folder(folder):
            assert folder.is_dir()
    assert list(tmp_path.iterdir()) == [tmp_path / "old"]


def test_where_nothing_is_everyone_may(tmp_path: Path) -> None:
    with claimed(tmp_path / "missing", "it is in use"):
        pass


def test_a_file_in_place_of_the_folder_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "data").touch()
    with pytest.raises(AssetError, match="data cannot be written"), claimed_folder(tmp_path / "data"):
        pass


def test_a_shared_claim_keeps_away_who_wants_the_folder_alone(tmp_path: Path) -> None:
    refused = partial(pytest.raises, AssetError, match="it is in use; wait until")
    shared = partial(claimed_folder, tmp_path, shared=True)
    with shared(), shared(), refused(), claimed(tmp_path, "it is in use", patience=0.0):
        raise AssertionError
    with claimed_folder(tmp_path), refused(), claimed(tmp_path, "it is in use", shared=True, patience=0.0):
        raise AssertionError
