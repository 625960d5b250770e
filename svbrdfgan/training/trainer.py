"""A training run from its configuration to its model."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
import torch
from lightning_fabric import Fabric

from svbrdfgan.data.index import PLAN, DatasetPlan
from svbrdfgan.errors import ConfigError, TrainingError
from svbrdfgan.metrics.recovered import Scorer, constant_layer
from svbrdfgan.plugins import RENDERERS, find_plugin
from svbrdfgan.rendering.compositing import layer_channels
from svbrdfgan.scene.loader import resolve_renderer
from svbrdfgan.training.batches import Feed, make_feed, make_seen
from svbrdfgan.training.config import TrainConfig, settled
from svbrdfgan.training.graceful_interrupt import interrupts_wait
from svbrdfgan.training.metrics_log import Journal
from svbrdfgan.training.run import CONFIG, MODEL, ORACLE, ORACLE_NOTES, RunConfig, save_generator, versions
from svbrdfgan.training.state import State, checkpoint_path, checkpoints, step_of
from svbrdfgan.training.step import Diagnostics, chance, training_step
from svbrdfgan.utils.display import Display, Silent

_REPORT_EVERY = 50

log = logging.getLogger(__name__)


def train(
    config: TrainConfig, run: Path, *, base: Path = Path(), resume: bool = False, display: Display | None = None
) -> State:
    """Trains a generator and writes the run's folder.

    Args:
        base: the folder that paths of the configuration are relative to.
        resume: goes on from the latest checkpoint; without it, the folder must not hold a run.

    Returns:
        The last state; where there were several processes, as its checkpoint keeps it.

    Raises:
        ConfigError: the folder holds another run, or the renderer or the device cannot do what is asked.
        AssetError: the data set or a checkpoint is missing or damaged.
        TrainingError: a loss is not finite.
        KeyboardInterrupt: after the step in which it came, which is saved, where there is one process.
    """
    require_device(config.device)
    resolved = _resolve(config, run, base, resume)
    precision = config.precision if config.precision != "auto" else auto_precision(config.device)
    fabric = Fabric(
        accelerator=config.device,
        devices=config.devices,
        strategy="ddp_spawn" if config.devices > 1 else "auto",
        precision=precision,
    )
    if config.devices > 1:
        fabric.launch(partial(_train_apart, resolved=resolved, run=run, base=base))
        state = State.fresh(config, torch.device("cpu"), layer_channels(resolved.dataset.maps))
        state.load(checkpoints(run)[-1])
        return state
    return _train(fabric, resolved, run, base, display or Silent())


def batch_indices(seed: int, count: int, batch_size: int, number: int) -> list[int]:
    """The exemplars of one batch: all exemplars in a new order each time round, whatever was drawn before."""
    positions = np.arange(number * batch_size, (number + 1) * batch_size)
    rounds = {int(r): np.random.default_rng([seed, int(r)]).permutation(count) for r in np.unique(positions // count)}
    return [int(rounds[int(p // count)][p % count]) for p in positions]


@dataclass(frozen=True, eq=False)
class _Session:
    """What one process holds while it trains."""

    fabric: Fabric
    config: TrainConfig
    run: Path
    feed: Feed
    scorer: Scorer | None
    journal: Journal | None
    display: Display

    @property
    def first(self) -> bool:
        return self.fabric.is_global_zero


def _resolve(config: TrainConfig, run: Path, base: Path, resume: bool) -> RunConfig:
    folder = (base / config.dataset).resolve()
    plan = DatasetPlan.load(folder)
    config = settled(config, plan.config.spp)
    resolved = RunConfig(train=config, dataset=plan.config, dataset_folder=str(folder), versions=versions())
    found = checkpoints(run)
    if (run / PLAN).is_file():
        raise ConfigError(f"{run} holds a data set; choose another folder for the run.")
    if (run / CONFIG).is_file() and found:
        if not resume:
            raise ConfigError(f"{run} holds a run already; give --resume to go on with it, or another folder.")
        RunConfig.load(run).require_same(resolved)
        done = step_of(found[-1])
        if config.steps < done:
            raise ConfigError(
                f"steps is {config.steps}, and {run} has made {done} already: name more, or start a new run."
            )
    else:
        if resume:
            log.warning("%s has no checkpoint to go on from: it begins anew", run)
        for left in (MODEL, ORACLE, ORACLE_NOTES):
            (run / left).unlink(missing_ok=True)
    return resolved


def require_device(device: str) -> None:
    """Refuses what torch cannot compute on here.

    Raises:
        ConfigError: it is "cuda", and torch sees no GPU.
    """
    if device == "cuda" and not torch.cuda.is_available():
        raise ConfigError("device: torch sees no CUDA GPU here; use auto or cpu, or install torch's build for CUDA.")


def auto_precision(device: str) -> Literal["bf16-mixed", "32-true"]:
    """What `precision: auto` means on a device."""
    cuda = device == "cuda" or (device == "auto" and torch.cuda.is_available())
    return "bf16-mixed" if cuda else "32-true"


def _train(fabric: Fabric, resolved: RunConfig, run: Path, base: Path, display: Display) -> State:
    session = _open(fabric, resolved, run, base, display)
    config, device = session.config, fabric.device
    state = State.fresh(config, device, layer_channels(resolved.dataset.maps), fabric.world_size)
    found = checkpoints(run)
    if found:
        state.load(found[-1])
        log.info("resumed at step %d", state.step)
    if session.first:
        session = replace(session, journal=Journal(run, state.step))
    display.begin("training", config.steps)
    display.advance(state.step)
    try:
        _loop(session, state)
    finally:
        if session.journal is not None:
            session.journal.close()
    return state


def _train_apart(fabric: Fabric, resolved: RunConfig, run: Path, base: Path) -> None:
    """Trains in a process that ends with the run: its tensors would end with it, so it gives back none."""
    _train(fabric, resolved, run, base, Silent())


def _open(fabric: Fabric, resolved: RunConfig, run: Path, base: Path, display: Display) -> _Session:
    config, device = resolved.train, fabric.device
    folder = Path(resolved.dataset_folder)
    renderer, chosen = resolve_renderer(config.renderer, device, resolved.maps, differentiable=True)
    if fabric.is_global_zero:
        origin = find_plugin(RENDERERS, chosen.name).origin
        made_by = {"renderer": f"{chosen.name} ({origin})"}
        resolved.model_copy(update={"versions": resolved.versions | made_by}).save(run)
    display.begin("light transport of the train scenes")
    feed = make_feed(config, folder, "train", renderer, device, base=base, progress=display.advance)
    scorer = None
    if "validation" in resolved.dataset.splits and fabric.is_global_zero:
        constant = constant_layer(feed.exemplars, feed.seen, device)
        display.begin("light transport of the validation scenes")
        held_out = make_seen(config, folder, "validation", renderer, display.advance)
        scorer = Scorer.make(*held_out, constant, device)
    return _Session(fabric, config, run, feed, scorer, None, display)


def _loop(session: _Session, state: State) -> None:
    config, began, before = session.config, time.monotonic(), state.seconds
    report_step, report_time = state.step, began
    coming = _batches(session, state.step)
    _expect(session, state.step, coming)
    latest: Diagnostics = {}
    with interrupts_wait(session.fabric.world_size == 1) as interrupted:
        while state.step < config.steps and not _out_of_time(session, state) and not interrupted():
            batches, coming = coming, _batches(session, state.step + 1)
            _expect(session, state.step + 1, coming)
            latest |= training_step(session.fabric, config, state, session.feed, batches)
            now = time.monotonic()
            state.seconds = before + now - began
            session.display.advance(1)
            if state.step % _REPORT_EVERY == 0:
                rate = (state.step - report_step) * config.images_per_step / max(now - report_time, 1e-9)
                _report(session, state, latest, rate)
                report_step, report_time, latest = state.step, time.monotonic(), {}
            if state.step % config.score_every == 0:
                _score(session, state)
            if state.step % config.save_every == 0 and state.step < config.steps:
                _save(session, state, latest)
        if interrupted():
            _save(session, state, latest)
            raise KeyboardInterrupt
    _finish(session, state, latest)


def _batches(session: _Session, step: int) -> list[Sequence[int]]:
    config, fabric = session.config, session.fabric
    critics = config.loss.critic_steps
    whole = [
        batch_indices(config.seed, len(session.feed), config.batch_size, step * critics + critic)
        for critic in range(critics)
    ]
    return [batch[fabric.global_rank :: fabric.world_size] for batch in whole]


def _expect(session: _Session, step: int, batches: Sequence[Sequence[int]]) -> None:
    """Has the scenes of a step read while those before it are played."""
    for critic, indices in enumerate(batches):
        session.feed.expect(indices, chance(session.fabric, session.config, step, critic))


def _out_of_time(session: _Session, state: State) -> bool:
    """Among several processes the first decides for all, at the steps at which they report and wait anyway."""
    minutes, fabric = session.config.minutes, session.fabric
    if minutes is None:
        return False
    over = state.seconds >= 60 * minutes
    if fabric.world_size == 1:
        return over
    return state.step % _REPORT_EVERY == 0 and fabric.broadcast(over)


def _report(session: _Session, state: State, diagnostics: Diagnostics, rate: float) -> None:
    _require_finite(session, state, diagnostics)
    values = {name: float(value) for name, value in diagnostics.items()}
    values |= {"images_per_second": rate, "seconds": state.seconds}
    if session.journal is not None:
        session.journal.write(state.step, values)
    score = f", recovered {state.history[-1]['recovered']:.3f}" if state.history else ""
    session.display.advance(0, f"{rate:.0f} images/s{score}")


def _score(session: _Session, state: State) -> None:
    """Scores the averaged generator on the validation split, and keeps it if it is the best so far."""
    if session.scorer is None or session.journal is None:
        return
    with session.fabric.autocast():
        layers = session.scorer.layers(state.averaged)
    score = session.scorer.recovered_by(layers)
    if not math.isfinite(score):
        raise _not_finite(session, state)
    session.journal.show(state.step, "learned above truth", session.scorer.picture(layers))
    state.history.append({"step": state.step, "seconds": state.seconds, "recovered": score})
    session.journal.write(state.step, {"recovered": score, "seconds": state.seconds})
    if score > state.best[0]:
        state.best = (score, state.step)
        save_generator(session.run / MODEL, state.averaged, session.config.generator, score)


def _save(session: _Session, state: State, diagnostics: Diagnostics) -> None:
    _require_finite(session, state, diagnostics)
    if session.first and not checkpoint_path(session.run, state.step).is_dir():
        state.save(session.run)


def _finish(session: _Session, state: State, diagnostics: Diagnostics) -> None:
    """The last score and checkpoint; where there was no validation split, the last model is the model."""
    _require_finite(session, state, diagnostics)
    if not session.first:
        return
    scores = len(state.history)
    if not state.history or state.history[-1]["step"] != state.step:
        _score(session, state)
    if session.scorer is None:
        save_generator(session.run / MODEL, state.averaged, session.config.generator, None)
    if len(state.history) > scores or not checkpoint_path(session.run, state.step).is_dir():
        state.save(session.run)


def _require_finite(session: _Session, state: State, diagnostics: Diagnostics) -> None:
    weights = {name: parameter.sum() for name, parameter in state.generator.named_parameters()}
    values = torch.stack([value.detach().float().reshape(()) for value in (diagnostics | weights).values()])
    if not bool(torch.isfinite(values).all()):
        raise _not_finite(session, state)


def _not_finite(session: _Session, state: State) -> TrainingError:
    saved = bool(checkpoints(session.run))
    return TrainingError(
        f"training stopped at step {state.step}: a loss or weight is not finite"
        f"{'; the last checkpoint is good' if saved else ''}. Lower optimizer.generator_rate or "
        f"optimizer.discriminator_rate, or raise loss.r1, and {'resume' if saved else 'start again'}."
    )
