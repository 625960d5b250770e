"""Whole runs: resumable to the bit, refused when they would be others, stopped when they go wrong."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from safetensors.torch import load_file
from torch import Tensor

from svbrdfgan.data.index import DatasetIndex
from svbrdfgan.errors import AssetError, ConfigError, TrainingError
from svbrdfgan.inference.apply import paint
from svbrdfgan.io.mesh import load_mesh
from svbrdfgan.networks.conditions import Conditions
from svbrdfgan.networks.saved import load_generator
from svbrdfgan.training import trainer
from svbrdfgan.training.config import TrainConfig, resolved, train_config
from svbrdfgan.training.metrics_log import read_metrics
from svbrdfgan.training.resolve import resolve_run
from svbrdfgan.training.run import MODEL, RunConfig, load_model
from svbrdfgan.training.state import State, checkpoints, step_of
from svbrdfgan.training.step import batch_indices
from svbrdfgan.training.trainer import train

Data = Callable[..., dict[str, Any]]
COMMAND = "from svbrdfgan.cli import main; main()"


@pytest.fixture
def config(training_data: Data) -> Callable[..., TrainConfig]:
    return lambda **changes: train_config(training_data(**changes), "here")


def final_weights(run: Path) -> dict[str, Tensor]:
    return load_file(checkpoints(run)[-1] / "state.safetensors")


def assert_same_weights(one: Path, other: Path) -> None:
    mine, its = final_weights(one), final_weights(other)
    assert mine.keys() == its.keys()
    assert [name for name, tensor in mine.items() if not torch.equal(tensor, its[name])] == []


@pytest.mark.parametrize(("count", "batch"), [(6, 2), (7, 3), (5, 8), (1, 4), (12, 12)])
def test_every_exemplar_is_visited_once_a_round(count: int, batch: int) -> None:
    rounds = 6
    drawn = [index for number in range(rounds * count) for index in batch_indices(3, count, batch, number)]
    for start in range(0, len(drawn) - count + 1, count):
        assert Counter(drawn[start : start + count]) == Counter(range(count))
    if count > 4:
        assert drawn[:count] != drawn[count : 2 * count]
    assert batch_indices(3, count, batch, 2) == drawn[2 * batch : 3 * batch]


def test_without_a_checkpoint_nothing_of_an_earlier_run_is_left(
    config: Callable[..., TrainConfig], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    for name in (MODEL, "oracle.safetensors", "oracle.json"):
        (tmp_path / name).write_text("of another run")
    train(config(steps=1, score_every=9), tmp_path, resume=True)
    assert "has no checkpoint to resume from: training starts at step 0" in caplog.text
    assert load_generator(tmp_path / MODEL)[1] is not None
    assert not (tmp_path / "oracle.json").exists()


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_a_gpu_that_is_not_there_is_told(config: Callable[..., TrainConfig], tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="sees no CUDA GPU"):
        train(config(device="cuda"), tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_a_run_leaves_its_model_its_log_and_what_it_was(
    config: Callable[..., TrainConfig], quick_renderer: str, tmp_path: Path
) -> None:
    state = train(config(), tmp_path / "run")
    assert state.step == 4
    assert [entry["step"] for entry in state.history] == [2, 4]
    model = load_model(tmp_path / "run")
    assert model.score == state.best[0] == max(entry["recovered"] for entry in state.history)
    assert model.config.train == resolved(config(), spp=8)
    assert [line["step"] for line in read_metrics(tmp_path / "run") if "recovered" in line] == [2, 4]
    versions = RunConfig.load(tmp_path / "run").versions
    assert versions["torch"] == torch.__version__
    assert versions["renderer"].startswith(f"{quick_renderer} (svbrdfgan")


def test_the_same_configuration_gives_the_same_weights(config: Callable[..., TrainConfig], tmp_path: Path) -> None:
    for name in ("one", "other"):
        train(config(), tmp_path / name)
    assert_same_weights(tmp_path / "one", tmp_path / "other")


@pytest.mark.full
def test_killed_and_resumed_it_ends_with_the_same_weights(
    training_data: Data, config: Callable[..., TrainConfig], tmp_path: Path
) -> None:
    changes = {"steps": 70, "save_every": 10, "score_every": 25}
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    train(config(**changes), whole)
    (tmp_path / "train.yaml").write_text(json.dumps(training_data(**changes)))
    words = [sys.executable, "-c", COMMAND, "train", str(tmp_path / "train.yaml"), "-o", str(killed)]
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while process.poll() is None and not checkpoints(killed):
        time.sleep(0.002)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    stopped_at = step_of(checkpoints(killed)[-1])
    assert 10 <= stopped_at < 70, "the process was not killed in the middle"
    state = train(config(**changes), killed, resume=True)
    assert state.step == 70
    assert_same_weights(whole, killed)
    assert state.best == best_of(whole)
    assert steps_of(killed) == steps_of(whole)
    one, other = (load_file(run / MODEL) for run in (whole, killed))
    assert all(torch.equal(one[name], other[name]) for name in one)


def best_of(run: Path) -> tuple[float, int]:
    score, step = json.loads((checkpoints(run)[-1] / "state.json").read_text())["best"]
    return score, step


def steps_of(run: Path) -> list[tuple[float, bool]]:
    return [(line["step"], "recovered" in line) for line in read_metrics(run)]


def test_a_longer_run_goes_on_from_a_shorter_one(config: Callable[..., TrainConfig], tmp_path: Path) -> None:
    train(config(steps=6), tmp_path / "whole")
    train(config(steps=4), tmp_path / "parts")
    train(config(steps=6), tmp_path / "parts", resume=True)
    assert_same_weights(tmp_path / "whole", tmp_path / "parts")


def test_a_finished_run_resumed_stays_as_it_is(config: Callable[..., TrainConfig], tmp_path: Path) -> None:
    train(config(), tmp_path / "run")
    before = final_weights(tmp_path / "run")
    state = train(config(), tmp_path / "run", resume=True)
    assert state.step == 4
    assert all(torch.equal(tensor, before[name]) for name, tensor in final_weights(tmp_path / "run").items())


def test_a_run_with_chance_and_conditions_goes_on_bit_for_bit(
    config: Callable[..., TrainConfig], varied_dataset: Path, tmp_path: Path
) -> None:
    varied = {"dataset": str(varied_dataset), "generator": {"width": 4, "blocks": 1, "random_fields": 2}}
    train(config(**varied, steps=4), tmp_path / "whole")
    train(config(**varied, steps=2), tmp_path / "parts")
    state = train(config(**varied, steps=4), tmp_path / "parts", resume=True)
    assert_same_weights(tmp_path / "whole", tmp_path / "parts")
    assert (state.generator.random_fields, state.generator.labels) == (2, 3)
    model = load_model(tmp_path / "whole")
    assert model.config.conditions == Conditions((0.2, 1.0), ("rust", "dust"))
    best = max(reversed(state.history), key=lambda entry: entry["rank"])
    assert (model.score, state.best) == (best["resemblance"], (best["resemblance"], best["step"]))
    parts = load_model(tmp_path / "parts").generator.state_dict()
    assert all(torch.equal(weight, parts[name]) for name, weight in model.generator.state_dict().items())


def test_a_run_starts_from_a_model(
    training_data: Data, varied_dataset: Path, shipped: Path, varied_run: Path, tmp_path: Path
) -> None:
    still = {"steps": 2, "optimizer": {"generator_rate": 1e-12}}
    data = {key: value for key, value in training_data(**still).items() if key != "generator"}
    for number, init in enumerate(("corroded", os.path.relpath(varied_run, tmp_path))):
        begun = train_config(data | {"dataset": str(varied_dataset), "init": init}, "here")
        run = tmp_path / str(number)
        train(begun, run, base=tmp_path)
        made, start = load_model(run), load_model(shipped if number == 0 else varied_run)
        for name, weights in start.generator.state_dict().items():
            torch.testing.assert_close(made.generator.state_dict()[name], weights, rtol=0, atol=1e-6)
        assert made.config.train.generator == start.config.train.generator
        train(begun.model_copy(update={"steps": 3}), run, base=tmp_path, resume=True)
    train(begun.model_copy(update={"steps": 4, "init": "corroded"}), run, base=tmp_path, resume=True)


def test_a_model_that_cannot_be_the_start_is_told_before_anything_is_written(
    config: Callable[..., TrainConfig], varied_dataset: Path, shipped: Path, tiny_dataset: Path, tmp_path: Path
) -> None:
    chance = {"width": 4, "blocks": 1, "random_fields": 3}
    for told, said in (
        ({"init": "corrode", "generator": chance}, r"^init: corrode is not a run.*did you mean 'corroded'\?"),
        ({"init": "corroded"}, r"^generator: the model .* other settings \(random_fields 0, not 3\)\."),
        (
            {"init": "corroded", "generator": chance, "dataset": str(tiny_dataset)},
            r"^init: the model is told each layer's amount and recipe .* must vary likewise\.",
        ),
    ):
        with pytest.raises((AssetError, ConfigError), match=said):
            train(config(**({"dataset": str(varied_dataset)} | told)), tmp_path / "run")
        assert not (tmp_path / "run").exists()


def test_conditions_are_told_with_chance_or_when_asked_for(
    config: Callable[..., TrainConfig], varied_dataset: Path
) -> None:
    def known(**generator: Any) -> Conditions:
        small = {"width": 4, "blocks": 1}
        return resolve_run(config(dataset=str(varied_dataset), generator=small | generator)).conditions

    assert known().size == known(random_fields=2, conditions=False).size == 0
    assert known(random_fields=2).size == known(conditions=True).size == 3


def test_a_run_is_not_overwritten(config: Callable[..., TrainConfig], tmp_path: Path) -> None:
    train(config(), tmp_path / "run")
    with pytest.raises(ConfigError, match="holds a run already; give --resume"):
        train(config(), tmp_path / "run")


def test_a_data_set_is_no_place_for_a_run(config: Callable[..., TrainConfig], tmp_path: Path) -> None:
    (tmp_path / "dataset.json").write_text("{}")
    with pytest.raises(ConfigError, match="holds a data set"):
        train(config(), tmp_path)
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"seed": 5}, r"train\.seed 0, not 5"),
        ({"loss": {"r2": 0.5}}, r"train\.loss\.r2 0.0, not 0.5"),
        ({"generator": {"width": 8}}, r"train\.generator\.width 4, not 8"),
        ({"scenes": {"pool": 2}}, r"train\.scenes\.pool 1, not 2"),
    ],
)
def test_other_settings_are_refused_by_name(
    changes: dict[str, Any], key: str, config: Callable[..., TrainConfig], tmp_path: Path
) -> None:
    train(config(steps=1), tmp_path / "run")
    with pytest.raises(ConfigError, match=rf"started with other settings \({key}\); start a new one"):
        train(config(**changes), tmp_path / "run", resume=True)
    assert RunConfig.load(tmp_path / "run").train == resolved(config(steps=1), spp=8)


def test_fewer_steps_than_were_made_are_refused(config: Callable[..., TrainConfig], tmp_path: Path) -> None:
    train(config(steps=4), tmp_path / "run")
    with pytest.raises(ConfigError, match=r"steps is 3, and .*run has made 4 already"):
        train(config(steps=3), tmp_path / "run", resume=True)
    assert RunConfig.load(tmp_path / "run").train.steps == 4
    assert train(config(steps=4), tmp_path / "run", resume=True).step == 4


def poisoned(at: int) -> Callable[..., dict[str, Tensor]]:
    """The step as it is, but for a loss that is not a number from that step on."""
    step = trainer.training_step

    def spoiled(fabric: Any, config: Any, state: State, *rest: Any) -> dict[str, Tensor]:
        told = step(fabric, config, state, *rest)
        return told | {"g_loss": torch.tensor(float("nan"))} if state.step >= at else told

    return spoiled


def test_a_loss_that_is_not_finite_stops_the_run(
    config: Callable[..., TrainConfig], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(trainer, "training_step", poisoned(at=3))
        with pytest.raises(
            TrainingError, match=r"stopped at step 4: .* not finite; the last checkpoint is good"
        ) as caught:
            train(config(steps=10), tmp_path / "run")
    assert len(str(caught.value).splitlines()) == 1
    assert [path.name for path in checkpoints(tmp_path / "run")] == ["step_00000002"]
    assert all(bool(tensor.isfinite().all()) for tensor in final_weights(tmp_path / "run").values())
    calmer = config(steps=4, optimizer={"generator_rate": 1e-5, "discriminator_rate": 2e-5}, loss={"r1": 1.0})
    resumed = train(calmer, tmp_path / "run", resume=True)
    assert resumed.step == 4
    assert [group["lr"] for group in resumed.generator_adam.param_groups] == [1e-5]
    assert RunConfig.load(tmp_path / "run").train.loss.r1 == 1.0


def test_the_data_set_may_be_named_otherwise_when_resumed(config: Callable[..., TrainConfig], tmp_path: Path) -> None:
    train(config(steps=1), tmp_path / "run")
    folder = Path(config().dataset)
    other = config(steps=2, dataset=folder.name)
    assert train(other, tmp_path / "run", base=folder.parent, resume=True).step == 2


@pytest.mark.parametrize("score_every", [2, 3])
def test_every_checkpoint_is_written_once(
    score_every: int, config: Callable[..., TrainConfig], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    saved, save = [], State.save
    monkeypatch.setattr(State, "save", lambda state, run: (saved.append(state.step), save(state, run)))
    train(config(steps=4, score_every=score_every), tmp_path / "run")
    train(config(steps=4, score_every=score_every), tmp_path / "run", resume=True)
    assert saved == [2, 4]
    assert json.loads((checkpoints(tmp_path / "run")[-1] / "state.json").read_text())["history"][-1]["step"] == 4


@pytest.mark.parametrize("steps", [3, 4])
def test_an_absurd_rate_stops_the_run(steps: int, config: Callable[..., TrainConfig], tmp_path: Path) -> None:
    """At a checkpoint, and at the end of a run between checkpoints."""
    absurd = config(steps=steps, optimizer={"generator_rate": 1e38}, save_every=4, score_every=4)
    with pytest.raises(TrainingError, match=r"Lower optimizer\.generator_rate .* and start again\.") as caught:
        train(absurd, tmp_path / "run")
    assert "checkpoint" not in str(caught.value)
    assert checkpoints(tmp_path / "run") == []
    with pytest.raises(AssetError, match="train the run until it has saved a model"):
        load_model(tmp_path / "run")


def test_without_a_validation_split_the_last_model_is_the_model(
    config: Callable[..., TrainConfig], dataset_copy: Path, tmp_path: Path
) -> None:
    path = dataset_copy / "dataset.json"
    plan = json.loads(path.read_text())
    for pools in (plan["config"]["splits"], plan["meshes"], plan["environments"]):
        del pools["validation"]
    path.write_text(json.dumps(plan))
    state = train(config(dataset=str(dataset_copy)), tmp_path / "run")
    assert state.history == []
    generator, score = load_generator(tmp_path / "run" / MODEL)
    assert score is None
    pairs = zip(generator.parameters(), state.averaged.parameters(), strict=True)
    assert all(torch.equal(a, b) for a, b in pairs)


@pytest.mark.parametrize(
    "changes",
    [
        {"scenes": {"pool": 0, "camera_noise_degrees": 2.0}},
        {"scenes": {"environment": "redrawn", "pool": 2}},
        {"scenes": {"environment": {"procedural": {"count": 2, "seed": 8}}}},
        {"rendering": "online", "discriminator": {"gbuffer": False}, "spp": 2, "spp_grad": 1},
        {"recipe": "thesis", "generator": {"norm": "instance"}, "loss": {"critic_steps": 2}},
        {"loss": {"name": "relativistic", "r2": 0.1}},
    ],
    ids=["pool 0", "redrawn", "other lights", "online", "thesis", "relativistic"],
)
def test_it_trains(
    changes: dict[str, Any], config: Callable[..., TrainConfig], dataset_copy: Path, tmp_path: Path
) -> None:
    state = train(config(dataset=str(dataset_copy), steps=2, **changes), tmp_path / "run")
    assert state.step == 2
    assert len(state.history) == 1


@pytest.mark.full
def test_two_processes_train_one_model(training_data: Data, config: Callable[..., TrainConfig], tmp_path: Path) -> None:
    """Half a batch each; what it ends with is what the last checkpoint holds."""
    (tmp_path / "train.yaml").write_text(json.dumps(training_data(steps=1, devices=2)))
    words = [sys.executable, "-c", COMMAND, "train", str(tmp_path / "train.yaml"), "-o", str(tmp_path / "two")]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "1 steps" in done.stdout
    assert load_model(tmp_path / "two").score is not None
    train(config(steps=1), tmp_path / "one")
    one, two = (final_weights(tmp_path / name) for name in ("one", "two"))
    assert one.keys() == two.keys()


def test_time_can_run_out(config: Callable[..., TrainConfig], tmp_path: Path) -> None:
    state = train(config(steps=10**6, minutes=0.001), tmp_path / "run")
    assert 1 <= state.step < 10**5
    assert checkpoints(tmp_path / "run")
    assert load_model(tmp_path / "run").score is not None


@pytest.mark.parametrize("told", [True, False])
def test_the_first_of_several_processes_says_when_time_is_out(told: bool, config: Callable[..., TrainConfig]) -> None:
    fabric = SimpleNamespace(world_size=2, broadcast=lambda mine: told)
    session: Any = SimpleNamespace(fabric=fabric, config=config(minutes=1.0))
    state = State.fresh(config(), torch.device("cpu"))
    state.seconds = 0.0 if told else 1e9
    assert trainer._out_of_time(session, state) is told
    state.step = 1  # between reports nobody asks
    assert trainer._out_of_time(session, state) is False


def test_no_data_set_is_told_before_anything_is_written(config: Callable[..., TrainConfig], tmp_path: Path) -> None:
    with pytest.raises(AssetError, match="is not a data set"):
        train(config(dataset="nowhere"), tmp_path / "run", base=tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_generator_paints_a_mesh_of_ones_own(
    config: Callable[..., TrainConfig], tmp_path: Path, tiny_dataset: Path
) -> None:
    train(config(), tmp_path / "run")
    model = load_model(tmp_path / "run")
    mesh = DatasetIndex.load(tiny_dataset).meshes["validation"][0]
    subject, layer = paint(load_mesh(tiny_dataset / mesh.asset.path), model)
    assert layer.values.shape == (32, 32, 4)
    assert not layer.values.requires_grad
    assert torch.equal(layer.values, model.generator(subject.geometry.unsqueeze(0))[0])
