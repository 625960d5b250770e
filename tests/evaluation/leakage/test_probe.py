"""The probe tells shortcuts that are there, names them, and finds none where real and fake are matched."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from svbrdfgan.data.exemplars import load_exemplars
from svbrdfgan.errors import ConfigError
from svbrdfgan.evaluation.leakage import probe
from svbrdfgan.evaluation.leakage.classifier import Trial
from svbrdfgan.evaluation.leakage.confounders import REMEDIES
from svbrdfgan.evaluation.leakage.probe import probe_shortcuts
from svbrdfgan.evaluation.leakage.report import LeakageReport
from svbrdfgan.io.environment import save_environment
from svbrdfgan.io.image import load_image
from svbrdfgan.plugins.registry import load_renderer
from svbrdfgan.rendering.checked_renderer import CheckedRenderer
from svbrdfgan.training.batches import make_scenes, own_buffers
from svbrdfgan.training.config import TrainConfig
from svbrdfgan.training.resolve import resolve_run
from svbrdfgan.types import Rendering

Training = Callable[..., TrainConfig]
HIGH = {"camera": {"elevation_degrees": {"uniform": [50.0, 70.0]}}}


def leaking(report: LeakageReport) -> set[str]:
    return {name for name, finding in report.alone.items() if finding.share and finding.share.leaks}


def tried(report: LeakageReport) -> set[str]:
    return {name for name, finding in report.alone.items() if finding.share}


@pytest.mark.full
@pytest.mark.parametrize("gbuffer", [True, False])
def test_matched_scenes_come_out_at_chance(gbuffer: bool, training: Training) -> None:
    report = probe_shortcuts(training(gbuffer=gbuffer)).report
    share = report.together.share
    assert share is not None
    assert not share.leaks
    assert (report.exemplars, report.judged, share.pairs) == (100, 40, 40)
    assert tried(report) == set()
    assert {finding.verdict for finding in report.alone.values()} == {"the same on both sides"}
    assert report.lines() == [f"No shortcut was found that tells more than {share.high:.0%} of pairs."]


@pytest.fixture(scope="module")
def red(boxes: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The boxes beside a red sky."""
    base = tmp_path_factory.mktemp("red")
    shutil.copytree(boxes, base / "dataset")
    save_environment(base / "red.exr", torch.tensor([1.0, 0.3, 0.3]).expand(8, 16, 3).contiguous())
    return base


LIT_RED: dict[str, Any] = {"environment": {"files": ["red.exr"]}, "camera": {}}
"""And cameras redrawn from the exemplars' own distribution, which nothing can tell."""


@pytest.mark.full
def test_other_light_is_told_and_named(training: Training, red: Path) -> None:
    report = probe_shortcuts(training(dataset="dataset", scenes=LIT_RED), base=red).report
    assert tried(report) == {"pose", "light"}
    assert leaking(report) == {"light"}
    assert report.together.share is not None
    assert report.together.share.leaks
    assert report.lines() == [f"light {report.alone['light'].verdict}. {REMEDIES['light']}"]


@pytest.mark.full
def test_neither_light_nor_pose_is_told_by_reflectance(training: Training, red: Path) -> None:
    """Nor by its G-buffer, where cameras differ as much as the light."""
    scenes = LIT_RED | HIGH
    report = probe_shortcuts(training("reflectance", dataset="dataset", scenes=scenes), base=red).report
    assert tried(report) == {"pose", "light", "noise"}
    assert leaking(report) <= {"noise"}


@pytest.mark.full
@pytest.mark.parametrize("spp", [2, 8])
def test_noise_is_told_by_reflectance_however_many_samples_fakes_have(spp: int, training: Training) -> None:
    report = probe_shortcuts(training("reflectance", spp=spp)).report
    assert (tried(report), leaking(report)) == ({"noise"}, {"noise"})
    assert report.alone["noise"].differs == "8 samples per pixel in exemplars, no noise in fakes"


@pytest.mark.full
def test_other_samples_are_told_and_named(training: Training) -> None:
    report = probe_shortcuts(training(spp=2)).report
    assert (tried(report), leaking(report)) == ({"noise"}, {"noise"})
    assert report.alone["noise"].differs == "8 samples per pixel in exemplars, 2 in fakes"
    assert report.alone["noise"].share == report.together.share


@pytest.mark.full
def test_other_cameras_are_told_without_transports_too(training: Training) -> None:
    online = training(scenes=HIGH, rendering="online", gbuffer=False)
    assert leaking(probe_shortcuts(online).report) == {"pose"}


@pytest.mark.full
def test_matched_scenes_of_gloss_come_out_at_chance(training: Training, glossy: Path) -> None:
    """Beside a light buffer that both sides share, so that its noise tells nothing either."""
    report = probe_shortcuts(training(dataset=str(glossy), rendering="online", gbuffer=True, light_buffer=True)).report
    share = report.together.share
    assert share is not None
    assert not share.leaks
    assert tried(report) == set()


@pytest.mark.full
def test_the_probe_shows_the_buffers_that_training_shows(
    training: Training, glossy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each side that of its own scene: the exemplars' from the stored scenes, the fakes' from the redrawn ones."""
    trials: list[Trial] = []
    monkeypatch.setattr(probe, "_MOST", 10)
    monkeypatch.setattr(Trial, "judge", lambda trial, _: trials.append(trial) or torch.zeros(len(trial.roles.judge)))
    other = training(
        dataset=str(glossy), rendering="online", scenes={"environment": "redrawn"}, gbuffer=True, light_buffer=True
    )
    probe_shortcuts(other)
    (trial,) = trials
    assert trial.config.discriminator.light_buffer is True
    run = resolve_run(other)
    exemplars, warp = load_exemplars(run.dataset, "train"), load_renderer("warp", {"device": "cpu"})
    scenes = make_scenes(run, exemplars, "train", warp, torch.device("cpu"))
    chosen = np.linspace(0, 99, 10).round().astype(int).tolist()
    gbuffers, lights, _ = own_buffers(run.config.discriminator, scenes, chosen, run.dataset.folder)
    for mine, its in ((trial.real.light_buffer, lights), (trial.real.gbuffer, gbuffers)):
        assert mine is not None
        assert its is not None
        assert torch.equal(mine, its)
    assert trial.fake.light_buffer is not None
    assert trial.real.light_buffer is not None
    assert (trial.fake.light_buffer - trial.real.light_buffer).abs().mean() > 0.1 * trial.real.light_buffer.mean()
    assert trial.fake.gbuffer is not None
    assert trial.real.gbuffer is not None
    assert torch.equal(trial.fake.gbuffer, trial.real.gbuffer)


@pytest.fixture
def trials(monkeypatch: pytest.MonkeyPatch) -> list[Trial]:
    """What the probe would show its classifiers of ten exemplars; they learn nothing."""
    shown: list[Trial] = []
    monkeypatch.setattr(probe, "_MOST", 10)
    monkeypatch.setattr(Trial, "judge", lambda trial, _: shown.append(trial) or torch.zeros(len(trial.roles.judge)))
    return shown


@pytest.mark.parametrize("rendering", ["online", "stored"])
def test_both_sides_show_the_true_layers_if_asked(
    rendering: str, training: Training, glossy: Path, trials: list[Trial]
) -> None:
    """The exemplars as they are, to the bit, and fakes that differ from them by noise alone."""
    matched = training(dataset=str(glossy), rendering=rendering, gbuffer=False)
    reports = [probe_shortcuts(matched, true_layers=true).report for true in (False, True)]
    assert [report.layers for report in reports] == ["none", "true"]
    clean, weathered = trials
    chosen = np.linspace(0, 99, 10).round().astype(int).tolist()
    exemplars = load_exemplars(resolve_run(matched).dataset, "train").images[chosen]
    assert torch.equal(weathered.real.image, exemplars)
    laid = exemplars - clean.real.image
    off = (weathered.fake.image - exemplars).mean(dim=(1, 2, 3)) / laid.mean(dim=(1, 2, 3))
    assert off.abs().mean() < 0.1


def test_exemplars_of_other_samples_show_their_true_layers_too(
    training: Training, glossy: Path, trials: list[Trial]
) -> None:
    config = training(
        dataset=str(glossy), rendering="online", gbuffer=False, spp=16, scenes={"camera_noise_degrees": 1e-6}
    )
    probe_shortcuts(config, true_layers=True)
    together, pose, noise = (trial.real.image.float() for trial in trials)
    assert torch.equal(together, noise)
    assert not torch.equal(together, pose)
    assert (pose - together).mean().abs() < 0.02 * together.mean()


@pytest.mark.full
def test_another_renderer_is_told_and_named(training: Training, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that made the exemplars half as bright again, which the others' trials do not see."""

    warp = load_renderer("warp", {"device": "cpu"})

    class Brighter(type(warp.plugin)):  # type: ignore[misc]
        def render(self, *given: Any, **more: Any) -> Rendering:
            rendering = super().render(*given, **more)
            return Rendering(rendering.image * 1.5, rendering.coverage)

    renderers = {"warp": CheckedRenderer(Brighter(device="cpu"), "brighter"), "auto": warp}
    monkeypatch.setattr(probe, "resolve_renderer", lambda choice, *_, **__: (renderers[choice.name], choice))
    report = probe_shortcuts(training(renderer="auto", scenes={"camera": {}})).report
    assert (tried(report), leaking(report)) == ({"pose", "renderer"}, {"renderer"})
    assert report.alone["renderer"].differs == "brighter with 1 bounce for exemplars, warp with 1 bounce for fakes"


@pytest.mark.full
def test_the_same_seed_is_the_same_probe(training: Training) -> None:
    one, again = (probe_shortcuts(training(scenes=HIGH)) for _ in range(2))
    clock = {"pictures_seconds", "learning_seconds"}
    assert one.report.model_dump(exclude=clock) == again.report.model_dump(exclude=clock)
    assert torch.equal(one.pairs, again.pairs)


def test_the_files(training: Training, few_boxes: Path, tmp_path: Path) -> None:
    probed = probe_shortcuts(training(dataset=str(few_boxes), scenes=HIGH), minutes=1e-6)
    probed.save(tmp_path / "out")
    record = json.loads((tmp_path / "out" / "probe.json").read_text())
    assert record["alone"]["pose"]["differs"] == "fakes' cameras are drawn from another distribution"
    assert record["alone"]["light"]["share"] is None
    assert record == probed.report.model_dump()
    assert load_image(tmp_path / "out" / "pairs.png").shape == (64, 8 * 32, 3)
    above, below = probed.pairs[:32], probed.pairs[32:]
    assert (above - below).abs().mean() > 0.01


@pytest.mark.full
def test_training_finds_what_the_probe_stored(training: Training, boxes: Path, tmp_path: Path) -> None:
    """The transports of the exemplars' own scenes and of the perturbed ones; none of the scenes in between."""
    folder = shutil.copytree(boxes, tmp_path / "dataset", ignore=shutil.ignore_patterns("transports"))
    both = training(dataset=str(folder), scenes={"camera_noise_degrees": 5.0, "environment": "redrawn"})
    probe_shortcuts(both, minutes=1e-6)
    assert len(list((folder / "cache" / "transports").iterdir())) == 2 * 100


def test_imported_pictures_are_refused(training: Training, few_boxes: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(few_boxes, tmp_path / "dataset")
    for path in (folder / "train").glob("*.json"):
        path.write_text(json.dumps(json.loads(path.read_text()) | {"weathering": "unknown"}))
    with pytest.raises(ConfigError, match="imported pictures"):
        probe_shortcuts(training(dataset=str(folder)))
