"""Training as processes that torchrun has started: the weights of our own launch, and one voice when one fails."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from safetensors.torch import load_file
from torch import Tensor

from svbrdfgan.errors import AssetError, ConfigError
from svbrdfgan.training.config import train_config
from svbrdfgan.training.resolve import make_fabric
from svbrdfgan.training.state import checkpoints, step_of
from svbrdfgan.training.trainer import _among, _require_shared
from svbrdfgan.utils.torchrun import Rank, torchrun_rank

Data = Callable[..., dict[str, Any]]
VARIABLES = {
    "RANK": "3",
    "WORLD_SIZE": "4",
    "LOCAL_WORLD_SIZE": "2",
    "LOCAL_RANK": "1",
    "MASTER_ADDR": "127.0.0.1",
    "MASTER_PORT": "1",
}


@pytest.fixture
def variables(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Sets torchrun's variables; None leaves one out."""

    def set_variables(**changes: str | None) -> None:
        for name, value in (VARIABLES | changes).items():
            monkeypatch.delenv(name, raising=False)
            if value is not None:
                monkeypatch.setenv(name, value)

    return set_variables


def test_the_rank_is_that_of_the_variables(variables: Callable[..., None]) -> None:
    variables()
    assert torchrun_rank() == Rank(3, 4, 2)
    variables(WORLD_SIZE="1", LOCAL_WORLD_SIZE="1", RANK="0")
    assert torchrun_rank() is None, "one process needs nobody"


@pytest.mark.parametrize("name", VARIABLES)
def test_without_one_of_the_variables_there_is_no_rank(name: str, variables: Callable[..., None]) -> None:
    variables(**{name: None})
    assert torchrun_rank() is None


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"WORLD_SIZE": "five"}, r"torchrun's RANK, WORLD_SIZE, LOCAL_WORLD_SIZE must be whole numbers: .*'five'"),
        ({"WORLD_SIZE": "5"}, "torchrun started 5 processes, and 2 of them here: wanted as many on every machine"),
    ],
)
def test_variables_that_contradict_each_other_are_told(
    changes: dict[str, str], said: str, variables: Callable[..., None]
) -> None:
    variables(**changes)
    with pytest.raises(ConfigError, match=said):
        torchrun_rank()


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"devices": 2, "batch_size": 4}, "devices is 2, and torchrun started 4 processes: leave the key out."),
        ({"devices": 1, "batch_size": 4}, "devices is 1, and torchrun started 4 processes: leave the key out."),
        ({"batch_size": 6}, "batch_size 6 cannot be shared out among the 4 processes that torchrun started"),
    ],
)
def test_settings_that_do_not_suit_the_processes_are_told(
    changes: dict[str, Any], said: str, training_data: Data
) -> None:
    with pytest.raises(ConfigError, match=re.escape(said)):
        _among(Rank(0, 4, 2), train_config(training_data(**changes), "here"))


@pytest.mark.parametrize("changes", [{}, {"devices": 4}])
def test_processes_count_as_devices(changes: dict[str, Any], training_data: Data) -> None:
    config = train_config(training_data(batch_size=8, **changes), "here")
    assert _among(Rank(0, 4, 2), config).devices == 4


def test_machines_must_share_the_run() -> None:
    fabric: Any = SimpleNamespace(broadcast=lambda mine: ["step_00000002"])
    _require_shared(fabric, Path("run"), ["step_00000002"])
    with pytest.raises(AssetError, match="run has other checkpoints here than for the first process: name a folder"):
        _require_shared(fabric, Path("run"), [])


def test_more_processes_than_gpus_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 1)
    with pytest.raises(ConfigError, match="torchrun started 2 processes here, and torch sees 1 GPUs: wanted at most"):
        make_fabric("auto", devices=4, rank=Rank(0, 4, 2))


class Nodes:
    """Two machines' torchrun, of one process each, on this one."""

    def __init__(self, config: Path, run: Path, *words: str) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        rendezvous = [
            f"--master-addr=127.0.0.1 --master-port={port} --nnodes=2 --nproc-per-node=1 --node-rank={node}"
            for node in range(2)
        ]
        self.processes = [
            subprocess.Popen(
                [
                    sys.executable,
                    "-m",
                    "torch.distributed.run",
                    *place.split(),
                    "-m",
                    "svbrdfgan",
                    "train",
                    str(config),
                    "-o",
                    str(run),
                    *words,
                ],
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                start_new_session=True,
            )
            for place in rendezvous
        ]

    def kill_worker(self, node: int) -> None:
        """Kills the process that trains, not torchrun, which started it."""
        (child,) = (
            Path(f"/proc/{self.processes[node].pid}/task/{self.processes[node].pid}/children").read_text().split()
        )
        os.kill(int(child), signal.SIGKILL)

    def end(self) -> list[tuple[int, str, list[str]]]:
        """The exit code of each machine's torchrun, what was printed on stdout, and the errors of our program."""
        printed = [process.communicate(timeout=240) for process in self.processes]
        errors = [[line for line in error.splitlines() if line.startswith("Error: ")] for _, error in printed]
        assert not any("svbrdfgan/" in line for _, error in printed for line in error.splitlines()), printed
        codes = [process.returncode for process in self.processes]
        return [(code, out, error) for code, (out, _), error in zip(codes, printed, errors, strict=True)]

    def close(self) -> None:
        for process in self.processes:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.communicate()


@pytest.fixture
def nodes(tmp_path: Path) -> Iterator[Callable[..., Nodes]]:
    """Starts the training of a configuration; what is left of it is killed after the test."""
    started: list[Nodes] = []

    def start(data: dict[str, Any], run: Path, *words: str) -> Nodes:
        config = tmp_path / f"train-{len(started)}.yaml"
        config.write_text(json.dumps(data))
        started.append(Nodes(config, run, *words))
        return started[-1]

    yield start
    for each in started:
        each.close()


def last_step(run: Path) -> int:
    return step_of(checkpoints(run)[-1])


def weights(run: Path) -> dict[str, Tensor]:
    """Those of the last checkpoint, of networks and optimizers."""
    found: dict[str, Tensor] = load_file(checkpoints(run)[-1] / "state.safetensors")
    return found


@pytest.mark.full
def test_two_machines_train_what_two_devices_of_one_do(
    nodes: Callable[..., Nodes], training_data: Data, tmp_path: Path
) -> None:
    (tmp_path / "train.yaml").write_text(json.dumps(training_data(steps=6, devices=2)))
    words = [sys.executable, "-m", "svbrdfgan", "train", str(tmp_path / "train.yaml"), "-o", str(tmp_path / "own")]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (first, said, none), (second, nothing, empty) = nodes(training_data(steps=6), tmp_path / "run").end()
    assert (first, second, nothing, none, empty) == (0, 0, "", [], [])
    assert f"{tmp_path / 'run'}: 6 steps in " in said
    assert (last_step(tmp_path / "run"), last_step(tmp_path / "own")) == (6, 6)
    found, wanted = weights(tmp_path / "run"), weights(tmp_path / "own")
    assert found.keys() == wanted.keys()
    assert [name for name, value in found.items() if not torch.equal(value, wanted[name])] == []


@pytest.mark.full
@pytest.mark.parametrize("killed", [0, 1])
def test_one_is_killed_and_the_other_says_so(
    killed: int, nodes: Callable[..., Nodes], training_data: Data, tmp_path: Path
) -> None:
    run = tmp_path / "run"
    whole = nodes(training_data(steps=100_000), run)
    while not checkpoints(run):
        assert all(process.poll() is None for process in whole.processes), whole.end()
        time.sleep(0.01)
    whole.kill_worker(killed)
    ended = whole.end()
    assert all(code != 0 for code, _, _ in ended)
    (error,) = [line for _, _, errors in ended for line in errors]
    step = last_step(run)
    assert error == (
        f"Error: another process of the training has ended; {run} keeps the checkpoint of step {step}, and the same "
        "command with --resume continues."
    )
    resumed = nodes(training_data(steps=step + 2), run, "--resume").end()
    assert [(code, errors) for code, _, errors in resumed] == [(0, []), (0, [])]
    assert last_step(run) == step + 2


@pytest.mark.full
@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"batch_size": 3}, "batch_size 3 cannot be shared out among the 2 processes"),
        ({"dataset": "missing"}, "missing is not a data set"),
        ({"devices": 4, "batch_size": 4}, "devices is 4, and torchrun started 2 processes"),
    ],
)
def test_faults_of_all_are_told_once(
    changes: dict[str, Any], said: str, nodes: Callable[..., Nodes], training_data: Data, tmp_path: Path
) -> None:
    ended = nodes(training_data(**changes), tmp_path / "run").end()
    assert all(code == 1 for code, _, _ in ended)
    (error,) = [line for _, _, errors in ended for line in errors]
    assert said in error


@pytest.mark.full
def test_a_fault_of_the_first_ends_both(nodes: Callable[..., Nodes], training_data: Data, tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "dataset.json").write_text("{}")
    ended = nodes(training_data(), tmp_path / "run").end()
    assert all(code == 1 for code, _, _ in ended)
    (error,) = [line for _, _, errors in ended for line in errors]
    assert error == f"Error: {tmp_path / 'run'} holds a data set; choose another folder for the run."
