"""`svbrdfgan view`."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
from pathlib import Path
from urllib.request import urlopen

import pytest
from click.testing import CliRunner

from svbrdfgan.cli import main

pytest.importorskip("xatlas")


def test_a_page_is_written(van: Path, tmp_path: Path) -> None:
    page = tmp_path / "van.html"
    words = ["view", str(van), "--recipe", "dust", "--resolution", "512", "--page", str(page)]
    done = CliRunner().invoke(main, words)
    assert done.exit_code == 0, done.output
    assert done.stdout == f"{page}\n"
    assert "/layer/0/0/2/100/512" in page.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["missing.glb"], "missing.glb"),
        (["van.txt"], "van.txt"),
        (["."], "is not a run"),
        (["VAN", "--recipe", "rusty"], "recipe 'rusty' does not exist"),
        (["VAN", "--keep", "*"], "weathers; name parts by --learnable"),
        (["VAN", "--environment", "missing.hdr"], "missing.hdr"),
    ],
)
def test_what_cannot_be_shown_is_said(
    van: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str], sentence: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "van.txt").write_text("no mesh")
    done = CliRunner().invoke(main, ["view", *(str(van) if word == "VAN" else word for word in words)])
    assert done.exit_code == 1
    assert sentence in done.stderr
    assert done.stdout == ""


@pytest.mark.full
def test_a_run_is_shown_beside_the_truth(varied_run: Path, tmp_path: Path) -> None:
    page = tmp_path / "run.html"
    done = CliRunner().invoke(main, ["view", str(varied_run), "--resolution", "512", "--page", str(page)])
    assert done.exit_code == 0, done.output
    stored = re.search(r'id="stored">(.*?)</script>', page.read_text(encoding="utf-8"), re.DOTALL)
    assert stored is not None
    (piece,) = json.loads(stored[1])["/state"]["pieces"]
    labels = [choice["label"] for choice in piece["choices"]]
    refused = CliRunner().invoke(main, ["view", str(varied_run), "--recipe", "rust"])
    assert "--model and --recipe are for mesh files" in refused.stderr
    assert sorted(labels) == ["Learned: Dust", "Learned: Rust", "Truth: Dust", "Truth: Rust"]


def test_the_server_says_where_it_is_and_ends_by_ctrl_c(van: Path) -> None:
    command = [sys.executable, "-m", "svbrdfgan", "view", str(van), "--recipe", "dust", "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        address = process.stdout.readline().strip()
        assert address.startswith("http://127.0.0.1:")
        with urlopen(address) as page:
            assert b"<title>van.glb</title>" in page.read()
        process.send_signal(signal.SIGINT)
        _, told = process.communicate(timeout=30)
    assert process.returncode == 0
    assert "the server has ended" in told
