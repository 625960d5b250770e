"""A run's log: what is in it, and that it stays whole."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
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


DOCTORED = [
    b"null",
    b"[]",
    b"3",
    b'{"loss": 1}',
    b'{"step": "2"}',
    b'{"step": null}',
    b'{"step": 2, "loss": "\xe4"}',
    b"[" * 50_000,
]
"""Lines that no run writes."""


@pytest.mark.parametrize("line", DOCTORED)
def test_lines_that_are_no_reports_are_left_out(line: bytes, tmp_path: Path) -> None:
    (tmp_path / "log.jsonl").write_bytes(
        b'{"step": 1, "loss": 0.5}\n' + line + b'\n{"step": 3, "loss": 0.25}\n{"step": 4, "lo'
    )
    assert [told["step"] for told in read_metrics(tmp_path)] == [1, 3]
    MetricsLog(tmp_path, 3).close()
    assert (tmp_path / "log.jsonl").read_text().splitlines() == [
        '{"step": 1, "loss": 0.5}',
        '{"step": 3, "loss": 0.25}',
    ]


def test_very_many_lines_are_thinned_and_end_with_the_last(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("svbrdfgan.training.metrics_log._MOST", 8)
    (tmp_path / "log.jsonl").write_text("".join(f'{{"step": {step}}}\n' for step in range(100)))
    steps = [told["step"] for told in read_metrics(tmp_path)]
    assert len(steps) <= 10
    assert (steps[0], steps[-1]) == (0, 99)
    assert len({after - before for before, after in itertools.pairwise(steps[:-1])}) == 1, "evenly"
    MetricsLog(tmp_path, 98).close()
    assert len((tmp_path / "log.jsonl").read_text().splitlines()) == 99, "the file keeps all"


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

    def full(path: Path) -> Iterator[dict[str, float]]:
        yield {"step": 1}
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("svbrdfgan.training.metrics_log._lines", full)
    with pytest.raises(AssetError, match="No space left"):
        MetricsLog(tmp_path, 1)
    assert (tmp_path / "log.jsonl").read_text() == before


def test_a_full_disk_is_one_sentence(tmp_path: Path) -> None:
    log = MetricsLog(tmp_path, 0)
    (tmp_path / "log.jsonl").unlink()
    (tmp_path / "log.jsonl").symlink_to("/dev/full")
    with pytest.raises(AssetError, match=r"log\.jsonl cannot be written \(No space left on device\)"):
        log.write(1, {"d_loss": 1.0})
