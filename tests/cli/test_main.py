"""The command line answers at once, and prints errors as one sentence."""

import os
import re
import subprocess
import sys
from types import SimpleNamespace

import click
import pytest
from click.testing import CliRunner

from svbrdfgan import __version__, cli
from svbrdfgan.cli.options import completed
from svbrdfgan.errors import AssetError

HELP = "import sys; sys.argv = ['svbrdfgan', '--help']\nfrom svbrdfgan.cli import main\n"


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """Makes `svbrdfgan demo` raise what the test puts in its `error`."""
    module = SimpleNamespace(error=AssetError("car.glb has no faces."))

    @click.command()
    def fails() -> None:
        raise module.error

    module.fails = fails
    monkeypatch.setitem(sys.modules, "cli_under_test", module)
    monkeypatch.setattr(cli, "COMMANDS", {"demo": ("cli_under_test:fails", "Fails.")})
    return module


def test_help_is_quick_and_imports_nothing_heavy() -> None:
    code = HELP + "try:\n    main()\nexcept SystemExit:\n    print('\\nLOADED', *sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    text, _, loaded = done.stdout.partition("\nLOADED ")
    assert all(re.search(rf"^  {name} ", text, re.MULTILINE) for name in cli.COMMANDS)
    assert {"torch", "numpy", "pydantic", "rich", "trimesh"} & set(loaded.split()) == set()
    assert [name for name in loaded.split() if name.startswith("svbrdfgan.cli.")] == []
    assert len(loaded.split()) < 300  # 137 by CPython 3.11, in a tenth of a second


def test_the_help_of_no_command_imports_torch() -> None:
    code = (
        "import sys\nfrom svbrdfgan.cli import COMMANDS, main\n"
        "heavy = {'torch', 'numpy', 'scipy', 'matplotlib', 'trimesh', 'warp', 'mitsuba'}\n"
        "for name in COMMANDS:\n"
        "    main([name, '--help'], standalone_mode=False)\n"
        "    print('\\nLOADED', name, *(heavy & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = [line.split()[1:] for line in done.stdout.splitlines() if line.startswith("LOADED")]
    assert loaded == [[name] for name in cli.COMMANDS]
    assert done.stdout.count("Usage: ") == len(cli.COMMANDS)


def test_what_paints_with_a_model_does_not_import_torch_s_compiler() -> None:
    """Lightning Fabric does, which takes a third of the time of all that painting imports."""
    code = "import sys, svbrdfgan.inference.learned, svbrdfgan.inference.apply; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert {"lightning_fabric", "torch._dynamo"} & set(done.stdout.split()) == set()


def test_the_names_are_fixed() -> None:
    names = "demo backends embeddings check bake parts weather dataset probe train learn evaluate experiment"
    assert list(cli.COMMANDS) == [*names.split(), "view", "texture", "models", "render", "bench"]


def test_the_package_is_the_program() -> None:
    """From a file `__main__.py`, click would call the program `python -m svbrdfgan`."""
    done = subprocess.run([sys.executable, "-m", "svbrdfgan", "--help"], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("Usage: svbrdfgan [OPTIONS] COMMAND ")


def test_names_that_terminals_obey_are_not_completed() -> None:
    complete = completed(lambda: ["rust", "ru\x1b[31m", "ru\nst"])
    assert [item.value for item in complete(click.Context(cli.main), click.Argument(["name"]), "ru")] == ["rust"]


@pytest.mark.parametrize(
    ("words", "incomplete", "offered"),
    [
        ([], "tr", ["train"]),
        ([], "", list(cli.COMMANDS)),
        ([], "--qu", ["--quiet"]),
        (["weather"], "--rec", ["--recipe"]),
        (["dataset"], "p", ["pose", "photograph", None]),
        (["dataset"], "me", ["merge", None]),
        (["dataset", "import"], "--pre", ["--preview"]),
        (["models"], "r", ["road-dirt", "rust"]),
        (["texture", "--model"], "ru", ["rust", None]),
        (["evaluate", "--split"], "t", ["train", "test"]),
    ],
)
def test_shells_complete_commands_and_options(words: list[str], incomplete: str, offered: list[str | None]) -> None:
    """None stands for paths."""
    code = (
        "import sys\nfrom svbrdfgan.cli import main\ntry:\n    main(prog_name='svbrdfgan')\nexcept SystemExit:\n"
        "    print('LOADED', *({'torch', 'numpy', 'scipy', 'trimesh'} & set(sys.modules)))"
    )
    asked = {
        "_SVBRDFGAN_COMPLETE": "bash_complete",
        "COMP_WORDS": " ".join(["svbrdfgan", *words, incomplete]),
        "COMP_CWORD": str(1 + len(words)),
    }
    done = subprocess.run(
        [sys.executable, "-c", code], env=os.environ | asked, capture_output=True, text=True, check=True
    )
    *lines, loaded = done.stdout.splitlines()
    assert [None if line in (f"file,{incomplete}", f"dir,{incomplete}") else line for line in lines] == [
        name and f"plain,{name}" for name in offered
    ]
    assert loaded.split() == ["LOADED"]


@pytest.mark.parametrize("words", ["models", "models rust", "backends", "embeddings", "experiment --list", "--version"])
def test_what_needs_no_tensor_loads_no_torch(words: str) -> None:
    """That takes seconds. Plugins are looked at in processes of their own."""
    code = (
        "import sys\nfrom svbrdfgan.cli import main\ntry:\n    main(prog_name='svbrdfgan')\nexcept SystemExit as end:\n"
        "    print('LOADED', end.code, *({'torch', 'scipy', 'trimesh'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code, *words.split()], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "LOADED 0"


def test_version() -> None:
    assert CliRunner().invoke(cli.main, ["--version"]).output == f"svbrdfgan, version {__version__}\n"


def test_an_error_is_one_sentence(command: SimpleNamespace) -> None:
    result = CliRunner().invoke(cli.main, ["demo"])
    assert (result.exit_code, result.stdout, result.stderr) == (1, "", "Error: car.glb has no faces.\n")


@pytest.mark.parametrize(("arguments", "variables"), [(["--debug", "demo"], {}), (["demo"], {"SVBRDFGAN_DEBUG": "1"})])
def test_debug_lets_it_through(command: SimpleNamespace, arguments: list[str], variables: dict[str, str]) -> None:
    assert CliRunner(env=variables).invoke(cli.main, arguments).exception is command.error


def test_an_interrupt_is_quiet(command: SimpleNamespace) -> None:
    command.error = KeyboardInterrupt()
    result = CliRunner().invoke(cli.main, ["demo"])
    assert (result.exit_code, result.output) == (130, "")


def test_what_the_system_refuses_is_one_sentence(command: SimpleNamespace) -> None:
    command.error = PermissionError(13, "Permission denied", "/data/out")
    result = CliRunner().invoke(cli.main, ["demo"])
    assert (result.exit_code, result.stderr) == (1, "Error: Permission denied (/data/out).\n")


def test_usage_errors_exit_with_2() -> None:
    result = CliRunner().invoke(cli.main, ["trian"])
    assert result.exit_code == 2
    assert "unknown command 'trian'; did you mean 'train'?" in result.stderr
    assert CliRunner().invoke(cli.main, ["backends", "--jsno"]).exit_code == 2


def test_verbose_logs_to_stderr() -> None:
    code = (
        "import sys; sys.argv = ['svbrdfgan', '-v', 'demo']\n"
        "from svbrdfgan import cli; import click, logging, types\n"
        "said = click.Command('said', callback=lambda: logging.getLogger('svbrdfgan.x').info('five faces'))\n"
        "sys.modules['made_up'] = types.SimpleNamespace(said=said)\n"
        "cli.COMMANDS = {'demo': ('made_up:said', '')}; cli.main()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "five faces" in done.stderr
    assert done.stdout == ""
