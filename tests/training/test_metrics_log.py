"""A run's log: what is in it, and that it stays whole."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from svbrdfgan.errors import AssetError
from svbrdfgan.training import trainer
from svbrdfgan.training.config import TrainConfig, train_config
from svbrdfgan.training.metrics_log import MetricsLog, read_metrics
from svbrdfgan.training.trainer import train


@pytest.fixture
def config(training_data: Callable[..., dict[str, Any]]) -> Callable[..., TrainConfig]:
    return lambda **changes: train_config(training_data(**changes), "here")


def test_a_penalty_between_reports_is_in_the_log(config: Callable[..., TrainConfig], tmp_path: Path) -> None:
    train(config(steps=50, score_every=50, save_every=50, loss={"penalty_every": 8}), tmp_path / "run")
    (told,) = [line for line in read_metrics(tmp_path / "run") if "d_loss" in line]
    assert told["step"] == 50
    assert told["d_penalty"] > 0


def test_the_end_of_an_interrupted_run_is_in_its_curves(
    config: Callable[..., TrainConfig], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    accumulator = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    monkeypatch.setattr(trainer, "_REPORT_EVERY", 1)
    step, made = trainer.training_step, []

    def stopped(*args: Any) -> Any:
        if len(made) == 2:
            raise KeyboardInterrupt
        made.append(1)
        return step(*args)

    monkeypatch.setattr(trainer, "training_step", stopped)
    with pytest.raises(KeyboardInterrupt):
        train(config(steps=50), tmp_path / "run")
    events = accumulator.EventAccumulator(str(tmp_path / "run" / "tensorboard")).Reload()
    assert [event.step for event in events.Scalars("g_loss")] == [1, 2]


def test_images_of_all_critic_steps_are_counted(
    config: Callable[..., TrainConfig], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = iter(range(1000))
    monkeypatch.setattr(trainer, "_REPORT_EVERY", 2)
    monkeypatch.setattr(trainer.time, "monotonic", lambda: float(next(now)))  # a second from each look to the next
    train(config(steps=2, loss={"critic_steps": 3}), tmp_path / "run")
    (told,) = [line for line in read_metrics(tmp_path / "run") if "images_per_second" in line]
    assert told["images_per_second"] == 2 * 2 * 3 / 2


def test_a_line_cut_off_by_a_kill_is_left_out(tmp_path: Path) -> None:
    (tmp_path / "log.jsonl").write_text('{"step": 1, "g_loss": 2.0}\n{"step": 2, "g_lo')
    assert read_metrics(tmp_path) == [{"step": 1, "g_loss": 2.0}]


def test_a_log_that_cannot_be_rewritten_stays_as_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = '{"step": 1, "g_loss": 2.0}\n{"step": 2, "g_loss": 1.0}\n'
    (tmp_path / "log.jsonl").write_text(before)

    def full(path: Path, text: str, **options: Any) -> None:
        with path.open("w") as file:
            file.write(text[:5])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(AssetError, match="No space left"):
        MetricsLog(tmp_path, 1)
    assert (tmp_path / "log.jsonl").read_text() == before
