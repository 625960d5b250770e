"""`svbrdfgan learn` does what its turns of `dataset import` and `train` would do, and goes on where it was."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
import yaml
from click.testing import CliRunner, Result

from svbrdfgan.cli import main
from svbrdfgan.data.photos import build
from svbrdfgan.io.image import load_image
from svbrdfgan.training import turns
from svbrdfgan.training.run import RunConfig
from svbrdfgan.training.state import checkpoints

SMALL = {"texture": 32, "bootstrap": 1, "embedding": {"name": "hemispherical", "resolution": 32}}
CAMERA = {"azimuth_degrees": 9, "elevation_degrees": 9, "distance": 9, "vertical_fov_degrees": 9}
QUICK = {"renderer": {"name": "mitsuba", "device": "cpu"}}


def learn(*words: object) -> Result:
    return CliRunner().invoke(main, ["learn", *map(str, words)])


def failed(result: Result, said: str) -> None:
    assert (result.exit_code, result.stdout) == (1, "")
    errors = [line for line in result.stderr.splitlines() if line.startswith("Error: ")]
    assert len(errors) == 1, result.output
    assert said in errors[0]


@pytest.fixture(scope="module")
def files(manifest: Path, training_data: Any) -> tuple[Path, Path]:
    """A manifest of one picture, and the configuration of a run, in different folders."""
    small = manifest.with_name("small.yaml")
    small.write_text(yaml.safe_dump({**yaml.safe_load(manifest.read_text()), **SMALL}))
    settings = training_data(**QUICK)
    del settings["dataset"]
    (manifest.parent / "runs").mkdir()
    config = manifest.parent / "runs" / "train.yaml"
    config.write_text(json.dumps(settings))
    return small, config


@pytest.fixture(scope="module")
def learned(files: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Result]:
    """What two turns made and said. Not to be changed."""
    out = tmp_path_factory.mktemp("learned") / "out"
    return out, learn(*files, "-o", out, "--turns", 2)


@pytest.fixture
def copied(learned: tuple[Path, Result], tmp_path: Path) -> Path:
    return Path(shutil.copytree(learned[0], tmp_path / "out"))


@pytest.fixture
def imports(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """The folders that pictures are imported into."""
    made: list[Path] = []

    def noted(manifest: Any, folder: Path, **options: Any) -> Any:
        made.append(folder)
        return build.import_pictures(manifest, folder, **options)

    monkeypatch.setattr(turns, "import_pictures", noted)
    return made


def test_a_turn_goes_on_from_the_run_before(learned: tuple[Path, Result]) -> None:
    out, result = learned
    assert result.exit_code == 0, result.output
    assert f"next: svbrdfgan texture MESH --model {out}/turn-2/run -o " in result.stdout
    assert "is ignored" not in result.stderr
    assert {path.name for path in out.iterdir()} == {"turns.json", "turn-1", "turn-2"}
    first, second = (RunConfig.load(out / f"turn-{number}" / "run") for number in (1, 2))
    assert (first.train.init, second.train.init) == (None, str((out / "turn-1" / "run").resolve()))
    assert (first.train.steps, second.train.steps) == (4, 2)
    assert second.dataset_folder == str((out / "turn-2" / "exemplars").resolve())
    light = "exemplars/assets/environments/light of picture 0.exr"
    assert (
        load_image(out / "turn-1" / light) != load_image(out / "turn-2" / light)
    ).any()  # fitted to what the run paints


@pytest.mark.parametrize("model", [False, True])
def test_what_is_there_is_not_made_again(
    model: bool, files: tuple[Path, Path], copied: Path, imports: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A run that was stopped goes on from its checkpoint, on exemplars that are there, even if it has a model."""
    if not model:
        (copied / "turn-2" / "run" / "model.safetensors").unlink()
    last = checkpoints(copied / "turn-2" / "run")[-1]
    shutil.rmtree(last)
    kept = {path: path.stat().st_mtime_ns for path in (copied / "turn-1").rglob("*") if path.is_file()}
    result = learn(*files, "-o", copied, "--turns", 2)
    assert result.exit_code == 0, result.output
    assert (copied / "turn-2" / "run" / "model.safetensors").is_file()
    assert last.is_dir()
    assert imports == []
    assert {path: path.stat().st_mtime_ns for path in (copied / "turn-1").rglob("*") if path.is_file()} == kept

    monkeypatch.setattr(turns, "train", None)
    assert learn(*files, "-o", copied, "--turns", 2).exit_code == 0


def test_a_turn_is_added(files: tuple[Path, Path], copied: Path, imports: list[Path]) -> None:
    assert learn(*files, "score_every=9", "-o", copied, "--turns", 3).exit_code == 0
    assert imports == [copied / "turn-3" / "exemplars"]
    assert RunConfig.load(copied / "turn-3" / "run").train.init == str((copied / "turn-2" / "run").resolve())


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["loss.name=lsgan"], "was begun with other settings (train.loss.name"),
        (["steps=8"], "(later_steps 2, not 5; train.steps 4, not 8)"),
        (["--later-steps", 3], "(later_steps 2, not 3)"),
        (["manifest.bootstrap=2"], "(manifest.bootstrap 1, not 2)"),
        (
            [f"manifest.pictures=[{{file: van.jpg, mesh: van.glb, camera: {json.dumps(CAMERA)}}}]"],
            "; and 3 more)",
        ),
    ],
)
def test_turns_by_other_settings_are_refused(
    files: tuple[Path, Path], learned: tuple[Path, Result], words: list[str], said: str
) -> None:
    failed(learn(*files, *words, "-o", learned[0]), said)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["manifest.pictures=[]"], "there is no picture to train on"),
        (["manifest.learnable.include=[x]"], "learnable"),
        (["manifest.model=nothing"], "model: "),
        (["steps=0"], "steps: 0 is not allowed"),
        (["generator.downsamplings=4"], "a texture of 32 texels cannot be halved 4 times"),
        (["init=nothing"], "init: "),
    ],
)
def test_errors_leave_nothing_behind(files: tuple[Path, Path], tmp_path: Path, words: list[str], said: str) -> None:
    failed(learn(*files, *words, "-o", tmp_path / "out"), said)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_in_use_is_refused(files: tuple[Path, Path], tmp_path: Path) -> None:
    (tmp_path / "mine.txt").touch()
    failed(learn(*files, "-o", tmp_path), "holds no turns; choose another folder")


def test_an_import_that_was_killed_may_begin_anew(
    files: tuple[Path, Path], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Its record stands alone then, and has no weight."""
    out = tmp_path / "out"
    out.mkdir()
    (out / "turns.json").write_text("{}")
    result = learn(*files, "dataset=other", "-o", out, "--turns", 1)
    assert result.exit_code == 0, result.output
    assert "train.yaml: dataset is ignored" in result.stderr
    assert "van.jpg: mask and mesh agree by 0." in caplog.text


def test_ctrl_c_says_how_to_go_on(files: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stopped(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(turns, "import_pictures", stopped)
    result = learn(*files, "-o", tmp_path / "out")
    assert result.exit_code == 130
    assert "stopped; " in result.stderr
    assert result.stderr.endswith("keeps complete imports and the last checkpoint, and the same command continues.\n")
    assert list(tmp_path.iterdir()) == []
