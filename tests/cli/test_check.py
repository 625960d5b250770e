"""What `svbrdfgan check` prints, and how it ends."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from rich.console import Console

from svbrdfgan.cli import main
from svbrdfgan.cli.check import summary, table
from svbrdfgan.plugins.probe import Probe, probe
from svbrdfgan.testing import Outcome

HALF = """
import torch
from svbrdfgan.protocols import RendererCapabilities
class Half:
    capabilities, device = RendererCapabilities(), torch.device("cpu")
    def prepare(self, surface): raise NotImplementedError("prepare is [not] written")
    def render(self, prepared, materials, view, *, spp, seed): ...
    def render_vjp(self, prepared, materials, view, grad_image, *, wrt, spp, seed): ...
"""


@pytest.fixture(autouse=True)
def trusted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Plugins are not tried in a process of their own, which takes seconds."""
    monkeypatch.setattr("svbrdfgan.plugins.probe.probe", lambda plugin: Probe("ok"))


@pytest.fixture
def plugins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A renderer that is half written, one that aborts, and one that has the name of an embedding."""
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "plug_half.py").write_text(HALF)
    (tmp_path / "plug_crash.py").write_text("import os; os.abort()")
    (tmp_path / "plug-1.0.dist-info").mkdir()
    entries = {"half": "plug_half:Half", "crash": "plug_crash:Made", "hemispherical": "plug_half:Half"}
    text = "".join(f"{name} = {target}\n" for name, target in entries.items())
    (tmp_path / "plug-1.0.dist-info/entry_points.txt").write_text(f"[svbrdfgan.renderers]\n{text}")


def run(*arguments: str) -> Result:
    return CliRunner(env={"COLUMNS": "100"}).invoke(main, ["check", *arguments])


def test_a_renderer_that_holds() -> None:
    result = run("numpy", "--only", "contract.")
    lines = result.stdout.splitlines()
    assert result.exit_code == 0
    assert "contract" in [line.strip() for line in lines]
    assert any("repr is one line" in line and "passed" in line for line in lines)
    assert " passed" in lines[-1]
    assert "failed" not in lines[-1]


def test_json_for_programs() -> None:
    result = run("numpy", "--only", "contract.test_it", "--json")
    rows = json.loads(result.stdout)
    assert {row["group"] for row in rows} == {"contract"}
    assert {row["name"] for row in rows} >= {"test_its_entry_point_finds_it", "test_it_pickles"}
    assert {row["status"] for row in rows} == {"passed"}
    assert set(rows[0]) == {"group", "name", "claim", "status", "message", "seconds"}


@pytest.mark.full
def test_an_embedding() -> None:
    result = run("hemispherical", "--only", "contract.")
    assert result.exit_code == 0, result.output
    assert "injective" not in result.stderr


def test_options_reach_the_renderer() -> None:
    with_transport, without = (
        run("numpy", "--option", f"max_bounces={n}", "--only", "transport_is_typed", "--json") for n in (1, 2)
    )
    assert json.loads(with_transport.stdout)[0]["status"] == "passed"
    assert json.loads(without.stdout)[0]["status"] == "not declared"
    wrong = run("numpy", "--option", "bounces=2")
    assert wrong.exit_code == 1
    assert wrong.stderr.splitlines()[-1].startswith("Error: numpy: unknown key 'bounces'")


def test_power_reaches_the_kit(monkeypatch: pytest.MonkeyPatch) -> None:
    powers = []
    monkeypatch.setattr("svbrdfgan.testing.kit.run_kit", lambda kit, only: powers.append(kit.power) or [])
    run("numpy", "--power", "0.125")
    run("numpy")
    assert powers == [0.125, 1.0]
    assert run("numpy", "--power", "0").exit_code == 2


@pytest.mark.usefixtures("plugins")
def test_failures_are_reported_with_their_reason_and_end_with_1() -> None:
    result = run("half", "--only", "stress.")
    assert result.exit_code == 1
    assert "prepare is [not] written" in result.stdout
    assert "again: --only stress.test_prepared_surfaces_stay_valid" in result.stdout
    assert result.stdout.splitlines()[-1].startswith("3 failed in ")
    assert run("half", "--only", "contract.test_it_is_a_renderer").exit_code == 0


@pytest.mark.usefixtures("plugins")
def test_one_that_aborts_is_reported_in_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("svbrdfgan.plugins.probe.probe", probe)
    result = run("crash")
    assert (result.exit_code, result.stdout) == (1, "")
    assert "Error: renderer 'crash' (plug 1.0) ended its process: SIGABRT." in result.stderr


@pytest.mark.usefixtures("plugins")
def test_a_name_of_both_kinds_needs_a_word_more() -> None:
    assert (
        "'hemispherical' is a renderer and an embedding; say --renderer or --embedding." in run("hemispherical").stderr
    )
    only = ("--only", "contract.test_options", "--json")
    assert (
        json.loads(run("hemispherical", "--renderer", *only).stdout)[0]["name"]
        == "test_options_have_types_and_defaults"
    )
    assert run("hemispherical", "--embedding", *only).exit_code == 0


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nump"], "no renderer and no embedding is called 'nump'; installed are renderers:"),
        (["numpy", "--embedding"], "embedding 'numpy' is unknown; installed are"),
        (["numpy", "--only", "no such"], "--only 'no such' names no test"),
    ],
)
def test_what_there_is_not(arguments: list[str], said: str) -> None:
    result = run(*arguments)
    assert (result.exit_code, result.stdout) == (1, "")
    assert said in result.stderr


@pytest.mark.parametrize("arguments", [["numpy", "--scene", "convex"], ["--pairs", "--only", "contract"]])
def test_options_of_the_other_check_are_refused(arguments: list[str]) -> None:
    result = run(*arguments)
    assert (result.exit_code, result.stdout) == (2, "")
    assert "--pairs" in result.stderr


def test_the_table_groups_its_rows_and_the_summary_counts() -> None:
    outcomes = [
        Outcome("shapes", "test_a", "A holds.", "passed", "", 0.5),
        Outcome("shapes", "test_b", "B holds.", "known failure", "not yet", 0.25),
        Outcome("light", "test_c", "C holds.", "not declared", "gloss is not declared", 0.0),
        Outcome("light", "test_d", "D holds.", "failed", "is [1, 2]", 1.0),
    ]
    console = Console(width=60, record=True, file=None, quiet=True)
    with console.capture() as capture:
        console.quiet = False
        console.print(table(outcomes))
    assert max(map(len, capture.get().splitlines())) <= 60
    lines = [line.strip() for line in capture.get().splitlines() if line.strip()]
    starts = (
        "shapes",
        "- A holds.",
        "- B holds.",
        "not yet",
        "light",
        "- C holds.",
        "- D holds.",
        "is [1, 2]",
        "again: --only light.test_d",
    )
    assert [line.split("  ")[0] for line in lines[2:]] == list(starts)
    assert "1.0" in lines[-3]
    plain = Console(width=90).render_str(summary(outcomes)).plain
    assert plain == "1 passed, 1 failed, 1 known failure, 1 not declared in 1.8 s"
