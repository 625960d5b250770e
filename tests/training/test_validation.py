"""The best generator is kept: by what it recovered, or by the resemblance of its draws."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import torch

from svbrdfgan.errors import AssetError
from svbrdfgan.metrics.draw_scorer import DrawScorer
from svbrdfgan.metrics.resemblance import Resemblance
from svbrdfgan.training.config import train_config
from svbrdfgan.training.metrics_log import read_metrics
from svbrdfgan.training.run import load_model
from svbrdfgan.training.state import State
from svbrdfgan.training.trainer import train
from svbrdfgan.utils.display import SilentDisplay

Data = Callable[..., dict[str, Any]]


@pytest.fixture
def varied(training_data: Data, varied_dataset: Path) -> dict[str, Any]:
    generator = {"width": 4, "blocks": 1, "random_fields": 2}
    return training_data(dataset=str(varied_dataset), generator=generator, steps=5, score_every=1)


def scored(monkeypatch: pytest.MonkeyPatch, scores: Iterator[float]) -> None:
    """Lets the resemblance of the generators that training scores be these."""

    def score(*_: object) -> Resemblance:
        value = next(scores)
        return Resemblance(
            patches=value, mean=value, deviation=value, spectrum=value, joint=value, amount=value, subjects=1, draws=8
        )

    monkeypatch.setattr(DrawScorer, "score", score)


def test_a_generator_that_fails_in_one_part_is_kept_if_it_is_far_better_in_all_others(
    varied: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As one was lost that had learned rust: the first to be scored had a little of every part."""
    others = iter((0.3, 0.8, 0.7, 0.2, 0.1))
    joint = iter((0.06, -3.6, -0.5, 0.06, 0.06))

    def score(*_: object) -> Resemblance:
        value, worst = next(others), next(joint)
        return Resemblance(
            patches=value, mean=value, deviation=value, spectrum=value, joint=worst, amount=value, subjects=1, draws=8
        )

    monkeypatch.setattr(DrawScorer, "score", score)
    assert train(train_config(varied, "here"), tmp_path / "run").best == (0.0, 2)
    assert load_model(tmp_path / "run").score == 0.0


def weights_at(states: dict[int, dict[str, torch.Tensor]], monkeypatch: pytest.MonkeyPatch) -> None:
    """Keeps the averaged generator of every step."""
    average = State.average

    def kept(self: State, *arguments: Any) -> None:
        average(self, *arguments)
        states[self.step] = {name: value.clone() for name, value in self.averaged.state_dict().items()}

    monkeypatch.setattr(State, "average", kept)


@pytest.mark.parametrize(
    ("scores", "best"), [((0.1, 0.5, 0.7, 0.6, 0.2), 3), ((0.0, 0.0, 0.0, 0.0, 0.0), 5), ((0.3, 0.0, 0.3, 0.0, 0.0), 3)]
)
def test_the_generator_whose_draws_resemble_most_is_kept(
    varied: dict[str, Any],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    scores: tuple[float, ...],
    best: int,
) -> None:
    states: dict[int, dict[str, torch.Tensor]] = {}
    weights_at(states, monkeypatch)
    scored(monkeypatch, iter(scores))
    state = train(train_config(varied, "here"), tmp_path / "run")
    assert state.best == (pytest.approx(max(scores)), best)
    model = load_model(tmp_path / "run")
    assert model.score == pytest.approx(max(scores))
    kept = model.generator.state_dict()
    assert all(torch.equal(kept[name], value) for name, value in states[best].items())
    log = [line for line in read_metrics(tmp_path / "run") if "resemblance" in line]
    assert [line["step"] for line in log] == [1, 2, 3, 4, 5]
    assert [line["resemblance_joint"] for line in log] == list(scores)
    assert not any("recovered" in line for line in log), "one draw recovers no other"


def test_where_true_draws_cannot_be_compared_the_last_generator_is_kept(
    varied: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise AssetError("the textures are too small.")

    monkeypatch.setattr(DrawScorer, "make", refuse)
    with caplog.at_level(logging.WARNING):
        state = train(train_config(varied, "here"), tmp_path / "run", display=SilentDisplay())
    assert "the last generator is kept: the textures are too small." in caplog.text
    model = load_model(tmp_path / "run")
    assert model.score is None
    averaged = state.averaged.state_dict()
    assert all(torch.equal(value, averaged[name]) for name, value in model.generator.state_dict().items())
    assert [entry.keys() for entry in state.history] == [{"step", "seconds"}] * 5
    assert json.loads((tmp_path / "run" / "config.json").read_text())["train"]["score_every"] == 1
