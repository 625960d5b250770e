"""Names from files are shown on terminals, which do not obey them."""

from __future__ import annotations

import logging
import os
import pty
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
import trimesh
from click.testing import CliRunner

from svbrdfgan import cli
from svbrdfgan.cli import main
from svbrdfgan.errors import ConfigError
from svbrdfgan.utils.printable import PrintableFormatter, printable

if TYPE_CHECKING:
    from collections.abc import Iterator

HOSTILE = "door\x1b]0;owned\x07\x1b[2J\r\x9b31m\x7f\u202egpj\u2066"
SHOWN = r"door\x1b]0;owned\x07\x1b[2J\r\x9b31m\x7f\u202egpj\u2066"
PRINTS = "click.echo(", "print(", "click.secho("


@pytest.fixture
def hostile_mesh(tmp_path: Path) -> Path:
    """A box whose node and material are named by a stranger."""
    box = trimesh.creation.box((1.8, 1.4, 4.2))
    box.visual = trimesh.visual.TextureVisuals(
        material=trimesh.visual.material.PBRMaterial(name=f"{HOSTILE}\nwarning: a")
    )
    path = tmp_path / f"{HOSTILE}.glb"
    trimesh.Scene({f"{HOSTILE}\nwarning: b": box}).export(path)
    return path


def obeyed(text: str) -> set[str]:
    return {letter for letter in text if not letter.isprintable() and letter not in "\n\t"}


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        (HOSTILE, SHOWN),
        ("two\nlines", r"two\nlines"),
        ("a\tb", "a\tb"),
        ("half \ud800", r"half \ud800"),
        (
            "Tür, 車, e\u0301, \U0001f469\u200d\U0001f527, C:\\new",
            "Tür, 車, e\u0301, \U0001f469\u200d\U0001f527, C:\\new",
        ),
    ],
)
def test_what_terminals_obey_is_written_out(text: str, shown: str) -> None:
    assert printable(text) == shown


def test_texts_of_several_lines_keep_them() -> None:
    assert printable("a\nb\x1b", breaks=True) == "a\nb\\x1b"


@pytest.mark.parametrize("words", [["parts"], ["parts", "--json"], ["-vv", "parts"]], ids=" ".join)
def test_names_of_parts_are_shown(hostile_mesh: Path, words: list[str]) -> None:
    done = CliRunner().invoke(main, [*words, str(hostile_mesh)])
    assert done.exit_code == 0, done.output
    assert obeyed(done.output) <= {"\x7f"} if "--json" in words else not obeyed(done.output)
    assert "owned" in done.output


@pytest.mark.parametrize("words", [["parts"], ["weather", "--recipe", "dust", "-o", "OUT"]], ids=lambda words: words[0])
def test_errors_that_name_files_are_shown(hostile_mesh: Path, tmp_path: Path, words: list[str]) -> None:
    hostile_mesh.write_bytes(b"glTF broken")
    words = [str(tmp_path / "out.glb") if word == "OUT" else word for word in words]
    done = CliRunner().invoke(main, [words[0], str(hostile_mesh), *words[1:]])
    assert done.exit_code == 1
    assert SHOWN in done.stderr
    assert not obeyed(done.output)


def test_an_error_that_names_parts_is_one_line(hostile_mesh: Path, tmp_path: Path) -> None:
    words = ["weather", str(hostile_mesh), "--embedding-uvs", "--resolution", "16", "--learnable", "nothing"]
    done = CliRunner().invoke(main, [*words, "-o", str(tmp_path / "out.glb")])
    assert done.exit_code == 1
    (line,) = [line for line in done.stderr.splitlines() if "no visible part is learnable" in line]
    assert r"\nwarning: " in line
    assert not [line for line in done.stderr.splitlines() if line.startswith("warning: ")]


def test_an_error_of_several_sentences_has_a_line_for_each() -> None:
    error = ConfigError("a\nb", "c")
    assert str(error) == "a\nb\nc"
    assert error.args == ("a\nb", "c")


def test_a_message_is_logged_on_one_line_and_its_traceback_on_several() -> None:
    try:
        raise ValueError("x\x1b")
    except ValueError:
        record = logging.LogRecord("svbrdfgan", logging.WARNING, "a.py", 1, "%s\nwarning: b", ("a",), sys.exc_info())
    first, *traceback = PrintableFormatter().format(record).splitlines()
    assert first == r"a\nwarning: b"
    assert traceback[-1] == r"ValueError: x\x1b"


@pytest.mark.full
def test_a_terminal_is_not_written_to_by_names(hostile_mesh: Path) -> None:
    """A true terminal gets colours of ours, and nothing of the file's."""
    first, second = pty.openpty()
    command = [sys.executable, "-m", "svbrdfgan", "parts", str(hostile_mesh)]
    env = {**os.environ, "TERM": "xterm-256color", "COLUMNS": "300"}
    with subprocess.Popen(command, stdin=second, stdout=second, stderr=second, env=env) as process:
        os.close(second)
        said = b"".join(_chunks(first)).decode()
    assert process.returncode == 0, said
    assert "owned" in said
    for sign in ("\x1b]0;owned", "\x07", "\x1b[2J", "\x9b", "\x7f", "\u202e", "\u2066"):
        assert sign not in said


def _chunks(terminal: int) -> Iterator[bytes]:
    try:
        while chunk := os.read(terminal, 2**16):
            yield chunk
    except OSError:  # Linux: the other side has closed
        return


def test_logs_are_shown() -> None:
    record = logging.LogRecord("svbrdfgan", logging.WARNING, "a.py", 1, "%s is missing", (HOSTILE,), None)
    assert PrintableFormatter().format(record) == f"{SHOWN} is missing"


def test_warnings_without_a_handler_are_shown() -> None:
    CliRunner().invoke(main, ["models"])
    assert logging.lastResort is not None
    assert isinstance(logging.lastResort.formatter, PrintableFormatter)


def test_no_command_prints_around_it() -> None:
    """Lines go through `echo`, but for those that a program reads."""
    around = {
        line.strip()
        for path in Path(cli.__file__).parent.glob("*.py")
        for line in path.read_text(encoding="utf-8").splitlines()
        if line.strip().startswith(PRINTS) and "printable" not in line
    }
    assert around == {
        "click.echo(json.dumps(document, indent=2))",
        "click.echo(show.as_json(rows))",
        "click.echo(show.markdown(rows), nl=False)",
    }
