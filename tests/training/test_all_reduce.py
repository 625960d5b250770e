"""Means of gradients over processes. Run as a program, this file is what two processes do for these tests."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from lightning_fabric import Fabric
from torch import Tensor, nn

from svbrdfgan.networks.losses import gradient_square
from svbrdfgan.training import all_reduce as module
from svbrdfgan.training import trainer
from svbrdfgan.training.all_reduce import GradientAllReduce
from svbrdfgan.training.config import train_config
from svbrdfgan.training.resolve import ResolvedRun, resolve_run
from svbrdfgan.training.run import RunConfig
from svbrdfgan.utils.display import SilentDisplay

PROCESSES, STEPS, SMALL = 2, 3, 600
Gradients = list[Tensor | None]


class Network(nn.Module):
    """Two convolutions, and between them a weight that is not used."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(inputs, 8, 3, padding=1)
        self.unused = nn.Parameter(torch.ones(7))
        self.second = nn.Conv2d(8, outputs, 3, padding=1)
        self.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def forward(self, x: Tensor) -> Tensor:
        result: Tensor = self.second(torch.tanh(self.first(x)))
        return result


class Game:
    """A judge and a maker, who learn in turn from what each process has of the data."""

    def __init__(self) -> None:
        torch.manual_seed(1)
        self.judge, self.maker = Network(3, 1), Network(2, 3)

    def judging(self, step: int, rank: int) -> None:
        """A backward pass of the judge; every other one goes through a derivative."""
        self.judge.requires_grad_(True).zero_grad(set_to_none=True)
        given, real = data(step, rank)
        loss = (self.judge(self.maker(given).detach()) - self.judge(real)).mean()
        (loss + gradient_square(self.judge, real) if step % 2 == 0 else loss).backward()

    def making(self, step: int, rank: int) -> None:
        """A backward pass of the maker, through a judge that does not learn."""
        self.judge.requires_grad_(False)
        self.maker.zero_grad(set_to_none=True)
        self.judge(self.maker(data(step, rank)[0])).square().mean().backward()

    def play(self, learn: Callable[[nn.Module, Callable[[int], None]], None]) -> list[Gradients]:
        """The gradients of each update. `learn` is given a network and its backward pass for a rank."""
        told, players = [], [(self.judge, self.judging), (self.maker, self.making)]
        adams = [torch.optim.Adam(network.parameters(), 0.01) for network, _ in players]
        for step in range(STEPS):
            for (network, turn), adam in zip(players, adams, strict=True):
                learn(network, partial(turn, step))
                adam.step()
                told.append(gradients(network))
        return told


def data(step: int, rank: int) -> tuple[Tensor, Tensor]:
    rng = torch.Generator().manual_seed(100 * step + rank)
    return torch.randn(2, 2, 6, 6, generator=rng), torch.randn(2, 3, 6, 6, generator=rng)


def gradients(network: nn.Module) -> Gradients:
    return [None if p.grad is None else p.grad.clone() for p in network.parameters()]


def together(rank: int) -> list[Gradients]:
    """The game as one of several processes plays it."""
    game = Game()
    means = {network: GradientAllReduce(network, PROCESSES, SMALL) for network in (game.judge, game.maker)}

    def learn(network: nn.Module, turn: Callable[[int], None]) -> None:
        turn(rank)
        means[network].finish()

    return game.play(learn)


def alone() -> list[Gradients]:
    """The game of a single process that does the work of all and then takes means."""

    def learn(network: nn.Module, turn: Callable[[int], None]) -> None:
        shares = []
        for rank in range(PROCESSES):
            turn(rank)
            shares.append(gradients(network))
        for parameter, *parts in zip(network.parameters(), *shares, strict=True):
            there = [part for part in parts if part is not None]
            parameter.grad = torch.stack(there).mean(dim=0) if there else None

    return Game().play(learn)


def work(fabric: Fabric, folder: Path, resolved: ResolvedRun) -> None:
    """What each of the processes does and leaves: the game, and a training."""
    torch.save(together(fabric.global_rank), folder / f"game{fabric.global_rank}")
    state = trainer._train(fabric, resolved, RunConfig.of(resolved), folder / "run", SilentDisplay())
    learned = [p.detach() for network in (state.generator, state.discriminator) for p in network.parameters()]
    torch.save(learned, folder / f"training{fabric.global_rank}")


@pytest.fixture(scope="module")
def left(tmp_path_factory: pytest.TempPathFactory, training_data: Callable[..., dict[str, Any]]) -> Path:
    """The folder with what two processes left."""
    folder = tmp_path_factory.mktemp("processes")
    settings = training_data(steps=2, devices=PROCESSES, loss={"penalty_every": 2})
    (folder / "train.json").write_text(json.dumps(settings))
    done = subprocess.run([sys.executable, __file__, str(folder)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder


def loaded(path: Path) -> list[Any]:
    found: list[Any] = torch.load(path, weights_only=True)
    return found


@pytest.mark.full
@pytest.mark.parametrize("rank", range(PROCESSES))
def test_gradients_are_the_mean_of_all_processes(rank: int, left: Path) -> None:
    """Over updates that go on from each other, through penalties, with a weight that has no gradient."""
    got, want = loaded(left / f"game{rank}"), alone()
    assert len(got) == len(want) == 2 * STEPS
    for ours, plain in zip(got, want, strict=True):
        assert [gradient is None for gradient in ours] == [gradient is None for gradient in plain]
        assert sum(gradient is None for gradient in ours) == 1
        for a, b in zip(ours, plain, strict=True):
            torch.testing.assert_close(a, b, rtol=1e-5, atol=1e-7)


@pytest.mark.full
def test_processes_that_train_keep_the_same_weights(left: Path) -> None:
    """Each has exemplars, backgrounds and so gradients of its own."""
    one, other = (loaded(left / f"training{rank}") for rank in range(PROCESSES))
    assert len(one) == len(other) > 0
    assert all(torch.equal(a, b) for a, b in zip(one, other, strict=True))


@pytest.fixture
def sent(monkeypatch: pytest.MonkeyPatch) -> list[Tensor]:
    """What went out so far, as though to another process that has the same gradients: they are their own mean."""
    buckets: list[Tensor] = []

    def send(bucket: Tensor, *, async_op: bool) -> Any:
        assert async_op
        buckets.append(bucket)
        return SimpleNamespace(wait=lambda: bucket.mul_(PROCESSES))

    monkeypatch.setattr(module.dist, "all_reduce", send)
    return buckets


def backward(layers: Sequence[nn.Module], width: int = 16) -> None:
    x = torch.ones(1, width)
    for layer in layers:
        x = torch.tanh(layer(x))
    x.sum().backward()


def linear(count: int = 4, width: int = 16) -> nn.Sequential:
    torch.manual_seed(0)
    return nn.Sequential(*(nn.Linear(width, width, bias=False) for _ in range(count)))


def test_means_are_under_way_before_the_backward_pass_ends(sent: list[Tensor]) -> None:
    layers, seen = linear(), []
    mean = GradientAllReduce(layers, PROCESSES, bucket_bytes=1)
    layers[0].weight.register_hook(lambda _: seen.append(len(sent)))  # before the first layer's is accumulated
    backward(layers)
    assert seen == [3]
    assert len(sent) == 4
    mean.finish()
    assert len(sent) == 4


@pytest.mark.parametrize("order", [(0, 1, 2, 3), (3, 2, 1, 0), (1, 3, 0, 2), (0, 3)])
def test_the_order_is_that_of_the_buckets(order: Sequence[int], sent: list[Tensor]) -> None:
    """Whichever gradients come first, and whether they all do."""
    layers = linear()
    mean = GradientAllReduce(layers, PROCESSES, bucket_bytes=1)
    orders = []
    for way in (range(4), order):
        sent.clear()
        layers.zero_grad()
        backward([layers[number] for number in way])
        mean.finish()
        orders.append([bucket.data_ptr() for bucket in sent])
    assert orders[0] == orders[1]
    assert len(set(orders[0])) == 4


@pytest.mark.parametrize("set_to_none", [True, False])
@pytest.mark.parametrize("bucket_bytes", [1, SMALL, 10**6])
def test_gradients_lie_in_the_buckets_as_their_weights_do(
    bucket_bytes: int, set_to_none: bool, sent: list[Tensor]
) -> None:
    """Without a copy, at addresses that vector instructions can read, in each of several passes."""
    network, plain = Network(2, 3), Network(2, 3)
    plain.load_state_dict(network.state_dict())
    mean = GradientAllReduce(network, PROCESSES, bucket_bytes)
    for step in range(STEPS):
        sent.clear()
        for each in (network, plain):
            each.zero_grad(set_to_none)
            each(data(step, 0)[0]).square().sum().backward()
        mean.finish()
        buckets = {bucket.untyped_storage().data_ptr() for bucket in sent}
        for parameter, twin in zip(network.parameters(), plain.parameters(), strict=True):
            if twin.grad is None:
                assert parameter.grad is None
                continue
            assert parameter.grad is not None
            assert torch.equal(parameter.grad, twin.grad)
            assert parameter.grad.stride() == parameter.stride()
            assert parameter.grad.untyped_storage().data_ptr() in buckets
            assert parameter.grad.data_ptr() % 16 == 0
    assert not network.first.weight.is_contiguous()


def test_a_weight_left_out_this_time_sends_zeros(sent: list[Tensor]) -> None:
    """Not what it sent last time, which would be added by the others."""
    layers = linear(2)
    mean = GradientAllReduce(layers, PROCESSES)
    for way in ([0, 1], [0]):
        layers.zero_grad()
        backward([layers[number] for number in way])
        mean.finish()
    assert layers[1].weight.grad is None
    assert sent[-1].count_nonzero() == layers[0].weight.grad.count_nonzero()


def test_one_process_pays_nothing(sent: list[Tensor]) -> None:
    layers = linear()
    mean = GradientAllReduce(layers, 1)
    backward(layers)
    found = [p.grad for p in layers.parameters()]
    mean.finish()
    assert all(p.grad is gradient for p, gradient in zip(layers.parameters(), found, strict=True))
    assert not any(p._post_accumulate_grad_hooks for p in layers.parameters())
    assert sent == []


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    config = train_config(json.loads((folder / "train.json").read_text()), "here")
    resolved = resolve_run(config, folder)
    job = partial(work, folder=folder, resolved=resolved)  # Fabric takes no frozen dataclass as an argument
    Fabric(accelerator="cpu", devices=PROCESSES, strategy="ddp_spawn").launch(job)
