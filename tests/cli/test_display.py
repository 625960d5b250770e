"""Tables that are piped are whole and plain, and no command is silent for ten seconds."""

from __future__ import annotations

import json
import os
import pty
import re
import subprocess
import sys
import threading
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import trimesh
from click.testing import CliRunner
from rich.table import Table

from svbrdfgan.bench.programs import STEPS, Figures, Program
from svbrdfgan.cli import COMMANDS, display, main, probe
from svbrdfgan.cli.pace import Pace, duration
from svbrdfgan.errors import SvbrdfganError
from svbrdfgan.plugins.probe import Probe
from svbrdfgan.plugins.registry import Plugin
from svbrdfgan.testing import Outcome

LONG = "backward-samples-of-a-row-that-is-much-wider-than-any-terminal-on-which-it-was-ever-looked-at"


class TestTables:
    """Through a pipe with COLUMNS=40, which would cut or wrap a table of rich."""

    def printed(self, *words: object) -> str:
        result = CliRunner(env={"COLUMNS": "40", "FORCE_COLOR": "1"}).invoke(main, list(map(str, words)))
        assert result.exit_code == (1 if words[0] == "check" else 0), result.output
        for sign in ("…", "\x1b", "│", "┃", "─", "━"):
            assert sign not in result.stdout
        return result.stdout

    @pytest.mark.parametrize("name", ["backends", "embeddings"])
    def test_plugins(self, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
        plugins = [Plugin(LONG, name, f"distribution-of-{LONG}", "1.0", "a:B")]
        capabilities = {"maps": [LONG, "base_color"], "differentiable": [f"gradient-of-{LONG}"]}
        monkeypatch.setattr("svbrdfgan.cli.backends.list_plugins", lambda group: plugins)
        monkeypatch.setattr(
            "svbrdfgan.cli.backends.probe_all",
            lambda plugins: [Probe("ok", None, capabilities, "cpu", {}, {"option": LONG})],
        )
        lines = self.printed(name).splitlines()
        row = f"{LONG}  distribution-of-{LONG} 1.0  ok      "
        assert lines[1].startswith(row)
        assert lines[1].endswith(f"maps: {LONG}, base_color; differentiable: gradient-of-{LONG}")
        assert lines[2].strip() == f"options: option={LONG}"
        assert lines[0].split() == [
            "name",
            "distribution",
            "status",
            *["device"] * (name == "backends"),
            "capabilities",
        ]

    def test_embeddings_compared(self, tmp_path: Path) -> None:
        for height in (0.5, 1.5):
            trimesh.creation.box((1, height, 2)).export(tmp_path / f"box {height}.obj")
        names = [f"hemispherical,centre_height=-0.1{'0' * zeros}" for zeros in (60, 61)]
        words = [word for name in names for word in ("--embedding", name)]
        head = self.printed("embeddings", "--compare", tmp_path, "--resolution", 32, *words).splitlines()[0]
        assert head.split("  ")[0] == "median / worst"
        assert head.split()[3:] == names

    def test_check(self, monkeypatch: pytest.MonkeyPatch) -> None:
        outcomes = [
            Outcome("contract", "test_a", f"It says {LONG} in one line.", "passed", "", 0.5),
            Outcome("contract", "test_b", "It holds.", "failed", f"It says {LONG} {LONG}.", 0.5),
        ]
        monkeypatch.setattr("svbrdfgan.cli.check._outcomes", lambda *_: outcomes)
        lines = self.printed("check", "numpy").splitlines()
        assert lines[2].split("  ") == [f"- It says {LONG} in one line.", *[""] * 35, ["passed", "0.5"][0], "0.5"] or (
            lines[2].startswith(f"- It says {LONG} in one line.")
        )
        assert lines[4].strip() == f"It says {LONG} {LONG}."
        assert lines[-1] == "1 passed, 1 failed in 1.0 s"

    def test_pairs(self, monkeypatch: pytest.MonkeyPatch) -> None:
        from svbrdfgan.testing.pairs.table import Row

        row = Row("convex", ("numpy", LONG), "failed", (), (), f"{LONG} cannot {LONG}")
        monkeypatch.setattr("svbrdfgan.testing.pairs.table.installed_renderers", lambda: {"numpy": None})
        monkeypatch.setattr("svbrdfgan.testing.pairs.table.Table.rows", lambda table, scene: [row])
        text = self.printed("check", "--pairs", "--scene", "convex")
        assert f"  numpy, {LONG}  " in text
        assert "furthest apart  finds: sum, block  samples" in text
        assert f"convex, numpy and {LONG}: {LONG} cannot {LONG}" in text.splitlines()

    def test_experiments(self, monkeypatch: pytest.MonkeyPatch) -> None:
        from svbrdfgan.experiments.plan import Plan

        loaded = Plan.load("training", "cpu")
        titled = loaded.experiment.model_copy(update={"title": f"A title of {LONG}"})
        plan = Plan(LONG, titled, "cpu", loaded.profile)
        monkeypatch.setattr("svbrdfgan.experiments.definition.experiment_names", lambda: [LONG])
        monkeypatch.setattr(Plan, "load", classmethod(lambda cls, name, profile: plan))
        (line,) = [line for line in self.printed("experiment", "--list").splitlines() if line.startswith(LONG)]
        assert line.endswith(f"A title of {LONG}")

    def test_bench(self, monkeypatch: pytest.MonkeyPatch) -> None:
        def run(program: Program, *_: object) -> Figures:
            return Figures(f"{program.title} {LONG}", "cpu", dict.fromkeys(STEPS, 0.5), {"transport": 2**20}, {})

        monkeypatch.setattr(Program, "run", run)
        tiny = ("--vertices", 100, "--pixels", 4, "--texels", 4, "--spp", 1)
        text = self.printed("bench", *tiny, "--backend", "numpy", "--peer", f"peer-{LONG} {{scene}} {{spp}}")
        assert f"peer 'peer-{LONG} {{scene}} {{spp}}' {LONG} / this" in text
        assert re.search(rf"^renderer 'numpy' {LONG} +stored forward \+ backward +500 ", text, re.MULTILINE)

    def test_probe(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
        table = Table("confounder", "real and fake", title=f"title of {LONG}")
        table.add_row("pose", LONG)
        monkeypatch.setattr(probe, "_table", lambda diagnosis: table)
        probed = type("Probed", (), {"report": type("None", (), {"lines": lambda self: [LONG]})()})()
        monkeypatch.setattr("svbrdfgan.evaluation.leakage.probe.probe_shortcuts", lambda *_, **__: probed)
        (tmp_path / "train.yaml").write_text("dataset: data\n")
        lines = [f"title of {LONG}", "confounder  real and fake", f"pose        {LONG}", LONG]
        assert self.printed("probe", tmp_path / "train.yaml").splitlines() == lines


TABLE = (
    "from rich.table import Table; from svbrdfgan.cli.display import print_table\n"
    f"table = Table('name', 'what'); table.add_row('a', '{LONG}'); print_table(table)"
)


def test_a_real_pipe_gets_a_plain_table() -> None:
    variables = {**os.environ, "COLUMNS": "40", "FORCE_COLOR": "1"}
    done = subprocess.run([sys.executable, "-c", TABLE], capture_output=True, text=True, check=True, env=variables)
    assert done.stdout == f"name  what\na     {LONG}\n"


def test_a_terminal_gets_a_table_of_its_width() -> None:
    ours, its = pty.openpty()
    variables = {**os.environ, "COLUMNS": "40", "TERM": "xterm"}
    subprocess.run([sys.executable, "-c", TABLE], stdout=its, check=True, env=variables)
    os.close(its)
    said = b""
    try:
        while chunk := os.read(ours, 4096):
            said += chunk
    except OSError:  # Linux says so when the other side is closed
        pass
    lines = re.sub(r"\x1b\[\d+m", "", said.decode()).splitlines()
    assert {len(line) for line in lines} == {40}
    assert lines[-2].startswith("│ a ")


class FakeClock:
    """Counts how often other threads look at it: those are ticks."""

    def __init__(self) -> None:
        self.now, self.looks = 0.0, 0
        self._owner = threading.get_ident()

    def __call__(self) -> float:
        self.looks += threading.get_ident() != self._owner
        return self.now

    def pass_second(self) -> None:
        """One second; waits until a whole tick has seen it, for as long as there are ticks at all."""
        self.now += 1.0
        enough, deadline = self.looks + 3, time.monotonic() + 5
        while self.looks < enough and time.monotonic() < deadline:
            time.sleep(0.001)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> FakeClock:
    """A clock that only `work` moves, and a ticker that looks every few milliseconds."""
    clock = FakeClock()
    monkeypatch.setattr(display, "_clock", clock)
    monkeypatch.setattr(display, "_TICK_SECONDS", 0.001)
    return clock


class StoppedError(SvbrdfganError):
    """What long work ends with here."""


class Work:
    """Half a minute of work, second by second; notes when lines were printed."""

    def __init__(self, clock: FakeClock, monkeypatch: pytest.MonkeyPatch) -> None:
        self.clock, self.lines, self.times = clock, list[str](), [0.0]
        plain = display.click.echo

        def echo(text: str, err: bool = False) -> None:
            if err:
                self.lines.append(text)
                self.times.append(clock.now)
            plain(text, err=err)

        monkeypatch.setattr(display.click, "echo", echo)

    def __call__(self, *_: object, **__: object) -> Any:
        for _ in range(30):
            self.clock.pass_second()
        raise StoppedError("over")

    def longest_silence(self) -> float:
        times = [*self.times, self.clock.now]
        return max(after - before for before, after in pairwise(times))


@pytest.fixture
def work(clock: FakeClock, monkeypatch: pytest.MonkeyPatch) -> Work:
    return Work(clock, monkeypatch)


LONG_WORK = [
    ("demo --out {out}", "svbrdfgan.experiments.demo.open_demo", "starting the demo"),
    ("demo --out {out}", "svbrdfgan.experiments.demo.run_demo", "making the data set"),
    ("backends", "svbrdfgan.cli.backends.probe_all", "trying each plugin"),
    ("embeddings", "svbrdfgan.cli.backends.probe_all", "trying each plugin"),
    ("check numpy", "svbrdfgan.plugins.probe.probe", "trying renderer 'numpy'"),
    ("check numpy", "svbrdfgan.testing.kit.run_kit", "renderer 'numpy'"),
    ("check --pairs", "svbrdfgan.testing.pairs.table.installed_renderers", "trying the renderers"),
    ("check --pairs", "svbrdfgan.testing.pairs.table.Table.rows", "pairs of renderers, ci profile"),
    ("weather {mesh} -o {out}/a.glb", "svbrdfgan.inference.workpiece.load_asset", "loading"),
    ("weather {mesh} --resolution 16 -o {out}/a.glb", "svbrdfgan.cli.scenes.weathered_document", "weathering"),
    ("weather {mesh} --size 16 --resolution 16 -o {out}/a.glb", "svbrdfgan.cli.scenes.write_document", "writing"),
    ("weather {mesh} --embedding-uvs -o {out}/a.glb", "svbrdfgan.cli.embedded.make_subject", "unwrapping"),
    (
        "weather {mesh} --embedding-uvs --resolution 16 -o {out}/a.glb",
        "svbrdfgan.cli.embedded.weather",
        "weathering",
    ),
    ("bake {mesh} --resolution 16 -o {out}", "svbrdfgan.io.mesh.load_mesh", "loading"),
    ("bake {mesh} --resolution 16 -o {out}", "svbrdfgan.report.uv_summary.write_summary", "measuring and drawing"),
    ("parts {mesh}", "svbrdfgan.asset.asset.load_asset", "loading"),
    ("parts {mesh}", "svbrdfgan.asset.verdicts.judge", "judging the parts"),
    ("embeddings --compare {folder} --embedding lscm", "svbrdfgan.cli.uv_comparison.measure_embedding", "lscm"),
    ("view {mesh} --page {out}/a.html", "svbrdfgan.viewer.open.exhibit_of", "loading"),
    ("texture {mesh} --model {out} -o {out}/a.glb", "svbrdfgan.training.run.load_model", "loading"),
    ("models", "svbrdfgan.cli.models.shipped_models", "reading the cards"),
    ("dataset {dataset} -o {out}", "svbrdfgan.data.generate.generate", "unwrapping and baking"),
    ("dataset {dataset} -o {out} --dry-run", "svbrdfgan.data.estimate.estimate", "making a few exemplars"),
    ("dataset {dataset} -o {out} --preview", "svbrdfgan.data.estimate.preview", "rendering the preview"),
    ("dataset {dataset} -o {out} --shard 1/2", "svbrdfgan.data.generate.generate", "unwrapping and baking"),
    ("dataset merge {folder}", "svbrdfgan.data.merge.merge_shards", "looking for the exemplars"),
    ("dataset import {manifest} -o {out}", "svbrdfgan.data.photos.manifest.read_manifest", "reading"),
    ("dataset pose {folder} -o {out}", "svbrdfgan.data.photos.pose.pose_pictures", "looking into"),
    ("probe {train}", "svbrdfgan.evaluation.leakage.probe.probe_shortcuts", "opening the data set"),
    ("train {train} -o {out}", "svbrdfgan.training.trainer.train", "opening the data set"),
    ("learn {manifest} {train} -o {out}", "svbrdfgan.data.photos.manifest.read_manifest", "reading"),
    ("evaluate {out}", "svbrdfgan.evaluation.evaluate.evaluate", "opening"),
    ("experiment training -o {out}", "svbrdfgan.experiments.runner.run_experiments", "reading the experiments"),
    ("experiment --list", "svbrdfgan.experiments.definition.experiment_names", "reading the experiments"),
    ("render {scene} -o {out}/a.png", "svbrdfgan.scene.description.Scene.load", "loading"),
    ("bench", "svbrdfgan.bench.run.working_backends", "trying the renderers"),
    ("bench --backend numpy", "svbrdfgan.bench.standard_scenes.standard_scene", "programs"),
]


@pytest.mark.parametrize(("words", "slow", "said"), LONG_WORK, ids=lambda value: value.split(" ")[0])
def test_no_command_is_silent_for_ten_seconds(
    words: str, slow: str, said: str, work: Work, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = {name: tmp_path / f"{name}.yaml" for name in ("dataset", "train", "manifest")}
    files["dataset"].write_text(json.dumps({"splits": {"train": {"meshes": {"procedural": {"count": 1}}, "views": 1}}}))
    files["train"].write_text("dataset: data\n")
    files["manifest"].write_text("a: 1\n")
    trimesh.creation.box((1, 0.5, 2)).export(tmp_path / "box.obj")
    paths = {
        **files,
        "mesh": tmp_path / "box.obj",
        "scene": tmp_path / "s.json",
        "out": tmp_path / "out",
        "folder": tmp_path,
    }
    monkeypatch.setattr(slow, work)
    if "run_kit" in slow:
        monkeypatch.setattr("svbrdfgan.plugins.probe.probe", lambda plugin: Probe("ok"))
    if "Table.rows" in slow:
        monkeypatch.setattr("svbrdfgan.testing.pairs.table.installed_renderers", lambda: {"numpy": None})
    if "run_demo" in slow:
        monkeypatch.setattr("svbrdfgan.experiments.demo.open_demo", lambda out, display: out)
    result = CliRunner().invoke(main, words.format(**paths).split())
    assert "Error: over" in result.stderr, result.output
    assert work.longest_silence() <= 10, work.lines
    assert sum(said in line for line in work.lines) >= 3, work.lines
    assert result.stdout == (f"rust and road dirt:      {paths['out']}\n" if "run_demo" in slow else "")


def test_every_command_is_tried() -> None:
    assert {words.split()[0] for words, *_ in LONG_WORK} == set(COMMANDS)


def test_lines_say_how_far_it_is(clock: FakeClock, capsys: pytest.CaptureFixture[str]) -> None:
    lines = display.ProgressLines("opening")
    clock.now = 1.0
    lines.tick()
    assert capsys.readouterr().err == ""
    clock.now = 2.0
    lines.tick()
    lines.tick()
    lines.begin("training", 400, 200)
    lines.advance(30, "31 [images]/s")
    clock.now = 12.0
    lines.advance(20)
    lines.tick()
    lines.tick()
    lines.stage("writing", 7)
    clock.now = 60.0
    lines.tick()
    assert capsys.readouterr().err.splitlines() == [
        "  opening: 2 s",
        "training ...",
        "  training: 250 of 400 (62 %), 30 s left, 31 [images]/s",
        "  writing: 0 of 7 (0 %), 48 s",
    ]


def test_many_short_stages_are_not_silent(clock: FakeClock, capsys: pytest.CaptureFixture[str]) -> None:
    lines = display.ProgressLines("opening")
    for second in range(1, 31):
        clock.now = float(second)
        lines.tick()
        lines.stage(f"stage {second}")
    times = [int(line.split()[1].rstrip(":")) + 1 for line in capsys.readouterr().err.splitlines()]
    assert times == [8, 16, 24]


@pytest.mark.parametrize(
    ("at", "left"),
    [
        (20.0, 80.0),  # two steps of ten seconds each, and eight to go
        (26.0, 74.0),
        (30.0, 70.0),
        (60.0, 7 * 20.0),  # a step that takes 40 s counts as if it ended now
    ],
)
def test_time_left_is_by_the_rate_of_this_run(at: float, left: float) -> None:
    pace = Pace(total=100, began=0.0, earlier=90)
    assert pace.seconds_left(10.0) is None
    for now in (10.0, 20.0):
        pace.advance(1, now)
    assert pace.seconds_left(at) == pytest.approx(left)
    assert pace.count() == "92 of 100 (92 %)"


def test_nothing_is_said_of_time_that_nobody_knows() -> None:
    unbounded, over = Pace(None, 0.0), Pace(2, 0.0)
    unbounded.advance(5, 1.0)
    over.advance(2, 1.0)
    assert (unbounded.left(2.0), unbounded.count()) == ("", "5")
    assert (over.left(2.0), over.count()) == ("", "2 of 2 (100 %)")


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(0.6, "1 s"), (119.0, "119 s"), (150.0, "2 min"), (12000.0, "3 h 20 min")],
)
def test_durations(seconds: float, words: str) -> None:
    assert duration(seconds) == words


def test_a_short_stage_leaves_no_line(capsys: pytest.CaptureFixture[str]) -> None:
    with display.progress("a moment") as shown:
        shown.stage("another")
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(("words", "lines"), [([], 1), (["--quiet"], 0)])
def test_quiet_shows_warnings_and_results_alone(
    words: list[str], lines: int, clock: FakeClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    def listed() -> dict[str, Path]:
        for _ in range(3):
            clock.pass_second()
        display.note("it is late.")
        display.note("warning: the clock is wrong.")
        return {}

    monkeypatch.setattr("svbrdfgan.cli.models.shipped_models", listed)
    result = CliRunner().invoke(main, [*words, "models", "--json"])
    said = result.stderr.splitlines()
    assert said[lines:] == ["it is late."] * lines + ["warning: the clock is wrong."]
    assert (result.exit_code, result.stdout) == (0, "[]\n")


def test_a_terminal_has_bars(capsys: pytest.CaptureFixture[str]) -> None:
    from io import StringIO

    from rich.console import Console

    console = Console(file=StringIO(), force_terminal=True, width=100)
    with display._bars(console) as bars:
        bar = display.ProgressBar(bars, "opening")
        assert [task.description for task in bars.tasks] == ["opening"]
        bar.begin("training [2]", 4, 1)
        bar.advance(2, "fast")
        assert bars.tasks[0].percentage == 75
        assert [(task.description, task.completed, task.fields["note"]) for task in bars.tasks] == [
            ("training [2]", 3, "fast")
        ]
        bar.stage("writing")
        bar.begin("steps")
        bar.end()
        bar.end()
        assert [(task.description, task.finished) for task in bars.tasks] == [("training [2]", False), ("steps", True)]
