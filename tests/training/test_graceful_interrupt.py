"""Ctrl-C and SIGTERM: a step that was begun is ended and saved."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors.torch import load_file

from svbrdfgan.training.config import train_config
from svbrdfgan.training.graceful_interrupt import defer_interrupts
from svbrdfgan.training.run import load_model
from svbrdfgan.training.state import checkpoints
from svbrdfgan.training.trainer import is_finished, train
from svbrdfgan.utils.stopping import stopped_by_signals

Data = Callable[..., dict[str, Any]]
COMMAND = """
import os, signal
signal.signal(signal.SIGINT, signal.default_int_handler)
from svbrdfgan.cli import main
from svbrdfgan.training import trainer
step = trainer.training_step
def interrupted(fabric, config, state, *given):
    if state.step == 5:
        os.kill(os.getpid(), signal.{name})
    return step(fabric, config, state, *given)
trainer.training_step = interrupted
main()
"""


@pytest.fixture(autouse=True)
def plain_handler() -> Iterator[None]:
    """That of Python, which is not there in tests that a shell started in the background."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.full
@pytest.mark.parametrize(("name", "code"), [("SIGINT", 130), ("SIGTERM", 143)])
def test_training_ends_its_step_saves_it_and_goes_on_from_there(
    name: str, code: int, training_data: Data, tmp_path: Path
) -> None:
    data = training_data(steps=12, save_every=1000, score_every=100)
    (tmp_path / "train.yaml").write_text(json.dumps(data))
    command = COMMAND.replace("{name}", name)
    words = [sys.executable, "-c", command, "train", str(tmp_path / "train.yaml"), "-o", str(tmp_path / "stopped")]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == code
    assert done.stderr.splitlines()[-1].endswith(
        "keeps the checkpoint of step 6, and the same command with --resume continues."
    )
    assert [path.name for path in checkpoints(tmp_path / "stopped")] == ["step_00000006"]
    load_model(tmp_path / "stopped")  # although no score has chosen it
    assert not is_finished(tmp_path / "stopped")  # so that `svbrdfgan learn` goes on with it
    config = train_config(data, "here")
    train(config, tmp_path / "stopped", resume=True)
    train(config, tmp_path / "whole")
    assert is_finished(tmp_path / "stopped")
    mine, its = (load_file(checkpoints(tmp_path / run)[-1] / "state.safetensors") for run in ("stopped", "whole"))
    assert [name for name in its if not torch.equal(mine[name], its[name])] == []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_second_is_raised(number: int) -> None:
    with stopped_by_signals():
        before = signal.getsignal(number)
        with defer_interrupts() as interrupted:
            assert not interrupted()
            os.kill(os.getpid(), number)
            assert interrupted() == number
            with pytest.raises(KeyboardInterrupt):
                os.kill(os.getpid(), number)
        assert signal.getsignal(number) is before
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


def test_other_threads_and_other_handlers_are_left_alone() -> None:
    seen: list[object] = []

    def in_a_thread() -> None:
        with defer_interrupts():
            seen.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=in_a_thread)
    thread.start()
    thread.join()
    assert seen == [signal.default_int_handler]
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with defer_interrupts():
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
