"""`svbrdfgan bench`: what it prints and writes, and the one sentence where it cannot."""

import json
import shlex
import sys
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result
from PIL import Image

from svbrdfgan.bench.cases import Case
from svbrdfgan.bench.programs import STEPS, Figures, Program
from svbrdfgan.cli import main

TINY = ("--vertices", "2000", "--pixels", "16", "--texels", "16", "--spp", "2", "--repeats", "1")
LINE = '{"peer": "other 1.0", "spp": 2, "forward_s": 2.0, "forward_backward_s": 4.0}'


def bench(*words: object) -> Result:
    return CliRunner(env={"COLUMNS": "140"}).invoke(main, ["bench", *map(str, words)])


def peer(code: str) -> str:
    return shlex.join([sys.executable, "-S", "-c", code, "{scene}"])


def failed(result: Result, said: str) -> None:
    assert (result.exit_code, result.stdout) == (1, ""), result.output
    (line,) = [line for line in result.stderr.splitlines() if line.startswith("Error: ")]
    assert said in line
    assert "Traceback" not in result.stderr


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> tuple[Result, Path]:
    """A real run of the numpy renderer beside a peer that always says the same."""
    folder = tmp_path_factory.mktemp("bench") / "out"
    told = ("-o", folder, "--history", folder.with_name("bench.jsonl"))
    return bench(*TINY, "--backend", "numpy", "--peer", peer(f"print('{LINE}')"), *told), folder


@pytest.mark.full
def test_figures_of_a_real_run(measured: tuple[Result, Path]) -> None:
    result, folder = measured
    assert result.exit_code == 0, result.output
    data = json.loads((folder / "figures.json").read_text())
    assert (data["format"], data["repeats"], data["scaling"]) == ("svbrdfgan bench 1", 1, {})
    assert {"system", "processor", "cores", "threads", "python", "packages"} == set(data["machine"])
    (case,) = data["cases"]
    assert [case[key] for key in ("scene", "vertices", "faces", "pixels", "spp", "batch", "embedding_s")] == [
        *("standard", 2025, 3872, 16, 2, 1, None)
    ]
    (numpy,), (other,) = case["backends"], case["peers"]
    assert (numpy["name"], numpy["device"]) == ("numpy", "cpu")
    assert list(numpy["seconds"]) == list(STEPS)
    assert all(value > 0 for value in numpy["seconds"].values())
    assert numpy["seconds"]["stored_forward_backward"] < numpy["seconds"]["forward_backward"]
    assert other["seconds"] == {"forward": 2.0, "forward_backward": 4.0}
    assert set(other) == set(numpy) == {"name", "device", "seconds", "peak_bytes", "torch_bytes"}


def test_figures_are_compared_with_those_of_the_last_run(measured: tuple[Result, Path], tmp_path: Path) -> None:
    first, folder = measured
    assert "Since the last time" not in first.stdout
    history = tmp_path / "bench.jsonl"
    history.write_bytes(folder.with_name("bench.jsonl").read_bytes())
    result = bench(*TINY, "--backend", "numpy", "--peer", peer(f"print('{LINE}')"), "--history", history)
    _, _, compared = result.stdout.partition("Since the last time on this machine")
    (line,) = [line for line in compared.splitlines() if line.startswith("other 1.0") and " backward" in line]
    assert line.split()[-2:] == ["4,000", "1.00"]
    assert len(history.read_text().splitlines()) == 4


def test_the_table_has_the_ratios_of_the_run(measured: tuple[Result, Path]) -> None:
    result, folder = measured
    seconds = json.loads((folder / "figures.json").read_text())["cases"][0]["backends"][0]["seconds"]
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in (folder / "table.md").read_text().splitlines()]
    ratios = {(row[0], row[1]): row[-1] for row in rows if len(row) == 5}
    assert float(ratios["numpy", "forward"]) == pytest.approx(2.0 / seconds["forward"], rel=0.01)
    stored = ratios["numpy", "stored forward + backward"].replace(",", "")
    assert float(stored) == pytest.approx(4.0 / seconds["stored_forward_backward"], rel=0.01)
    assert (ratios["other 1.0", "forward"], ratios["numpy", "transport"]) == ("1.00", "")
    assert "standard: 2,025 vertices, 3,872 triangles, 16x16 pixels, 2 spp" in result.stdout
    assert "other 1.0 / this" in result.stdout


def test_plots(measured: tuple[Result, Path]) -> None:
    _, folder = measured
    assert sorted(path.name for path in folder.iterdir()) == ["figures.json", "table.md", "times.png"]
    with Image.open(folder / "times.png") as picture:
        assert picture.width > 600


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, Case]]:
    """Programs are not run: their time is made up, and who was asked for what is noted."""
    noted: list[tuple[str, Case]] = []

    def run(program: Program, case: Case, scene: Path, repeats: int) -> Figures:
        assert scene.stat().st_size > 0
        noted.append((program.title, case))
        steps = STEPS if "svbrdfgan.bench.backend" in program.words else STEPS[1:3]
        return Figures(program.title, "cpu", dict.fromkeys(steps, 0.5 * case.spp), {"transport": 2**20}, {})

    monkeypatch.setattr(Program, "run", run)
    return noted


def test_scaling(asked: list[tuple[str, Case]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every size is measured once, though axes cross; a peer that takes no batch has none."""
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    other = "peer {scene} --spp {spp}"
    result = bench(*TINY, "--backend", "numpy", "--peer", other, "--scaling", "-o", tmp_path)
    assert result.exit_code == 0, result.output
    data = json.loads((tmp_path / "figures.json").read_text())
    along: dict[str, list[Any]] = {
        axis: [data["cases"][place][axis] for place in places] for axis, places in data["scaling"].items()
    }
    assert along["vertices"] == [16, 196, 2025]
    assert along["pixels"] == [4, 8, 16, 32]
    assert along["spp"] == [1, 2, 8]
    assert along["batch"] == [1, 4, 16]
    ours = [case for title, case in asked if title == "renderer 'numpy'"]
    assert len(ours) == len(set(ours)) == len(data["cases"]) == 1 + 2 + 3 + 2 + 2
    theirs = [case for title, case in asked if title.startswith("peer")]
    assert len(theirs) == 2 * (len(ours) - 2)
    assert [(case["batch"], len(case["peers"])) for case in data["cases"] if case["batch"] > 1] == [(4, 0), (16, 0)]
    assert result.stdout.count("Along ") == 4
    assert {"times.png", "scaling.png"} < {path.name for path in tmp_path.iterdir()}


def test_defaults_are_every_working_renderer_and_more_samples_on_a_gpu(
    asked: list[tuple[str, Case]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("svbrdfgan.bench.run.working_backends", lambda: ("warp", "mitsuba"))
    monkeypatch.setattr("torch.cuda.is_available", lambda: True)
    result = bench("--vertices", "100", "--pixels", "4", "--texels", "4")
    assert result.exit_code == 0, result.output
    assert [(title, case.spp) for title, case in asked] == [
        ("renderer 'warp'", 16),
        ("renderer 'mitsuba'", 16),
        ("renderer 'warp'", 200),
        ("renderer 'mitsuba'", 200),
    ]
    assert "renderer 'warp' / this" in result.stdout  # ratios to the first, where there is no peer


@pytest.mark.usefixtures("asked")
def test_a_vehicle_has_a_table_of_its_own(tmp_path: Path) -> None:
    import torch

    from svbrdfgan.io.environment import save_environment
    from svbrdfgan.io.gltf.surface_files import save_mesh_glb
    from svbrdfgan.procedural.kinds import sample_vehicle
    from svbrdfgan.procedural.vehicle import build_vehicle

    save_mesh_glb(tmp_path / "van.glb", build_vehicle(sample_vehicle("van", 5)))
    save_environment(tmp_path / "sky.exr", torch.ones(8, 16, 3))
    files = ("--mesh", tmp_path / "van.glb", "--environment", tmp_path / "sky.exr")
    result = bench(*TINY, "--backend", "numpy", *files)
    assert result.exit_code == 0, result.output
    assert "van.glb: " in result.stdout
    assert "embed, bake" in result.stdout


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--peer", peer("print('fast')")), "gave no figures in its last line: 'fast' is not JSON."),
        (("--peer", "quick --really"), "can run none of the cases; put {scene} into its command"),
        (("--mesh", "none.glb", "--environment", "none.hdr"), "none.glb does not exist"),
        (("--mesh", "a.glb", "--environment", "a.hdr", "--embedding", "hemi"), "embedding 'hemi' is unknown"),
    ],
)
def test_mistakes_are_one_sentence(words: tuple[str, ...], said: str) -> None:
    failed(bench(*TINY, "--backend", "numpy", *words), said)


def test_unknown_renderers_are_reported_before_anything_is_measured() -> None:
    failed(bench(*TINY, "--backend", "numpi"), "renderer 'numpi' is unknown; did you mean 'numpy'?")


def test_a_renderer_that_fails_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    broken = Program("renderer 'numpy'", (sys.executable, "-S", "-c", "raise MemoryError('of the GPU')"))
    monkeypatch.setattr("svbrdfgan.bench.run.backend_programs", lambda names: (broken,))
    failed(bench(*TINY, "--backend", "numpy"), "renderer 'numpy' failed with exit code 1: MemoryError: of the GPU")


def test_a_mesh_needs_its_light() -> None:
    result = bench("--mesh", "car.glb")
    assert result.exit_code == 2
    assert "--mesh and --environment go together." in result.stderr
