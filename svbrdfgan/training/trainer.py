"""A training run from its configuration to its model."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import torch
from lightning_fabric import Fabric

from svbrdfgan.data.index import INDEX
from svbrdfgan.errors import AssetError, ConfigError, TrainingError
from svbrdfgan.io.claims import claimed_folder
from svbrdfgan.networks.saved import save_generator
from svbrdfgan.plugins.registry import RENDERERS, find_plugin
from svbrdfgan.plugins.select import resolve_renderer
from svbrdfgan.training.batches import BatchSource, load_seen_texels, make_batch_source
from svbrdfgan.training.config import TrainConfig
from svbrdfgan.training.graceful_interrupt import defer_interrupts
from svbrdfgan.training.memory import require_run
from svbrdfgan.training.metrics_log import MetricsLog
from svbrdfgan.training.resolve import ResolvedRun, make_fabric, resolve_run
from svbrdfgan.training.run import CONFIG, MODEL, ORACLE, ORACLE_NOTES, RunConfig, load_model
from svbrdfgan.training.state import State, checkpoint_path, checkpoints, progress_of, step_of
from svbrdfgan.training.step import Diagnostics, batch_indices, step_rng, training_step
from svbrdfgan.training.validation import Validation
from svbrdfgan.utils.display import Display, SilentDisplay
from svbrdfgan.utils.torchrun import Rank, torchrun_rank

_REPORT_EVERY = 50
"""Steps between two lines of the metrics log."""

log = logging.getLogger(__name__)


def train(
    config: TrainConfig, run: Path, *, base: Path = Path(), resume: bool = False, display: Display | None = None
) -> State:
    """Trains a generator and writes the run's folder.

    Under torchrun each process calls this, all share the run's folder, and the first one writes it.

    Args:
        base: the folder that paths of the configuration are relative to.
        resume: continues from the latest checkpoint; without it, the folder must not hold a run.

    Returns:
        The last state; with several processes, as its checkpoint stores it.

    Raises:
        ConfigError: the folder holds another run, the renderer or the device cannot do what is asked, or more memory is
            needed than may be taken.
        AssetError: the data set or a checkpoint is missing or damaged.
        TrainingError: a loss is not finite.
        KeyboardInterrupt: with one process, after the step in which Ctrl-C or SIGTERM came; that step is saved.
    """
    rank = torchrun_rank()
    if rank is not None:
        config = _among(rank, config)
    fabric = make_fabric(config.device, devices=config.devices, precision=config.precision, rank=rank)
    resolved = resolve_run(config, base)
    record = RunConfig.of(resolved)
    require_run(resolved, ("train", "validation"), fabric.device)
    if rank is not None:
        fabric.launch()
    with claimed_folder(run) if fabric.is_global_zero else nullcontext():
        if fabric.is_global_zero:
            _prepare_folder(run, record, resume)
        if config.devices > 1 and rank is None:
            # `partial` binds the records, since Fabric refuses frozen dataclasses among the arguments of a launch
            fabric.launch(partial(_train_in_process, resolved=resolved, record=record, run=run))
            state = _fresh_state(config, record, torch.device("cpu"))
            state.load(checkpoints(run)[-1])
            return state
        return _train(fabric, resolved, record, run, display or SilentDisplay())


def _among(rank: Rank, config: TrainConfig) -> TrainConfig:
    """The configuration for all processes that torchrun has started.

    Raises:
        ConfigError: `devices` is another number, or a batch cannot be shared out among them.
    """
    if config.devices != rank.processes and "devices" in config.model_fields_set:
        raise ConfigError(
            f"devices is {config.devices}, and torchrun started {rank.processes} processes: leave the key out."
        )
    if config.batch_size % rank.processes:
        raise ConfigError(
            f"batch_size {config.batch_size} cannot be shared out among the {rank.processes} processes that torchrun "
            "started: wanted a multiple of that."
        )
    return config.model_copy(update={"devices": rank.processes})


@dataclass(frozen=True, eq=False)
class _Session:
    """The state of a process while it trains. Only the first process validates and has a metrics log."""

    fabric: Fabric
    config: TrainConfig
    run: Path
    source: BatchSource
    validation: Validation | None
    metrics_log: MetricsLog | None
    display: Display

    @property
    def first(self) -> bool:
        return self.fabric.is_global_zero


def _prepare_folder(run: Path, record: RunConfig, resume: bool) -> None:
    """Refuses a folder that holds something else; removes models of a run that left no checkpoint."""
    if (run / INDEX).is_file():
        raise ConfigError(f"{run} holds a data set; choose another folder for the run.")
    found = checkpoints(run)
    if (run / CONFIG).is_file() and found:
        if not resume:
            raise ConfigError(f"{run} holds a run already; give --resume to go on with it, or another folder.")
        RunConfig.load(run).require_same(record)
        done = step_of(found[-1])
        if record.train.steps < done:
            raise ConfigError(
                f"steps is {record.train.steps}, and {run} has made {done} already: name more, or start a new run."
            )
        return
    if resume:
        log.warning("%s has no checkpoint to resume from: training starts at step 0", run)
    for name in (MODEL, ORACLE, ORACLE_NOTES):
        (run / name).unlink(missing_ok=True)


def _train(fabric: Fabric, resolved: ResolvedRun, record: RunConfig, run: Path, display: Display) -> State:
    session = _open_session(fabric, resolved, record, run, display)
    config, device = session.config, fabric.device
    state = _fresh_state(config, record, device, fabric.world_size)
    found = checkpoints(run)
    _require_shared(fabric, run, [path.name for path in found])
    if found:
        state.load(found[-1])
        log.info("resumed at step %d", state.step)
    elif config.init is not None:
        state.start_from(load_model(config.init).generator)
    elif config.refines is not None:
        state.take_refined(load_model(config.refines).generator)
    if session.first:
        session = replace(session, metrics_log=MetricsLog(run, state.step))
    display.begin("training", config.steps, state.step)
    try:
        _loop(session, state)
    finally:
        if session.metrics_log is not None:
            session.metrics_log.close()
    return state


def _fresh_state(config: TrainConfig, record: RunConfig, device: torch.device, processes: int = 1) -> State:
    return State.fresh(config, device, tuple(record.dataset.maps), processes, record.conditions.size)


def _require_shared(fabric: Fabric, run: Path, found: list[str]) -> None:
    """Refuses processes whose folder of the run is not the first one's."""
    if fabric.broadcast(found) != found:
        raise AssetError(
            f"{run} has other checkpoints here than for the first process: name a folder that all machines share."
        )


def _train_in_process(fabric: Fabric, resolved: ResolvedRun, record: RunConfig, run: Path) -> None:
    """Trains in a spawned process, and returns no state, since its tensors would end with the process."""
    _train(fabric, resolved, record, run, SilentDisplay())


def _open_session(fabric: Fabric, resolved: ResolvedRun, record: RunConfig, run: Path, display: Display) -> _Session:
    config, device = resolved.config, fabric.device
    renderer, choice = resolve_renderer(
        config.renderer, device, record.maps, differentiable=True, deferred=resolved.deferred
    )
    if fabric.is_global_zero:
        origin = find_plugin(RENDERERS, choice.name).origin
        made_by = {"renderer": f"{choice.name} ({origin})"}
        record.model_copy(update={"versions": record.versions | made_by}).save(run)
    source = make_batch_source(resolved, "train", renderer, device, display)
    validation = None
    if "validation" in record.dataset.splits and fabric.is_global_zero:
        total = len(resolved.dataset.index.sampler("validation"))
        display.begin("light transport of the validation scenes", total)
        held_out = load_seen_texels(resolved, "validation", renderer, display.advance)
        validation = Validation.make(fabric, resolved, (source.exemplars, source.seen), held_out)
    return _Session(fabric, config, run, source, validation, None, display)


def _loop(session: _Session, state: State) -> None:
    config, began, before = session.config, time.monotonic(), state.seconds
    report_step, report_time = state.step, began
    pending = _batches(session, state.step)
    _prefetch(session, state.step, pending)
    latest: Diagnostics = {}
    with defer_interrupts(session.fabric.world_size == 1) as interrupted:
        while state.step < config.steps and not _out_of_time(session, state) and not interrupted():
            batches, pending = pending, _batches(session, state.step + 1)
            _prefetch(session, state.step + 1, pending)
            latest |= training_step(session.fabric, config, state, session.source, batches)
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
            raise KeyboardInterrupt(interrupted())
    _finish(session, state, latest)


def _batches(session: _Session, step: int) -> list[Sequence[int]]:
    config, fabric = session.config, session.fabric
    critics = config.loss.critic_steps
    whole = [
        batch_indices(config.seed, len(session.source), config.batch_size, step * critics + critic)
        for critic in range(critics)
    ]
    return [batch[fabric.global_rank :: fabric.world_size] for batch in whole]


def _prefetch(session: _Session, step: int, batches: Sequence[Sequence[int]]) -> None:
    """Starts to read the scenes of a step while the step before it runs."""
    for critic, indices in enumerate(batches):
        session.source.prefetch(indices, step_rng(session.fabric, session.config, step, critic))


def is_finished(run: Path) -> bool:
    """Whether a run has made all its steps, or its minutes are over. One that was stopped may have a model, too.

    Raises:
        AssetError: the run's records are damaged.
    """
    found = checkpoints(run)
    if not found or not (run / CONFIG).is_file():
        return False
    config, (step, seconds) = RunConfig.load(run).train, progress_of(found[-1])
    return step >= config.steps or (config.minutes is not None and seconds >= 60 * config.minutes)


def _out_of_time(session: _Session, state: State) -> bool:
    """Whether `minutes` are over. The first process decides for all, at the steps at which they synchronise anyway."""
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
    if session.metrics_log is not None:
        session.metrics_log.write(state.step, values)
    measure = None if session.validation is None else session.validation.measure
    score = f", {measure} {state.history[-1][measure]:.3f}" if measure and state.history else ""
    session.display.advance(0, f"{rate:.0f} images/s{score}")


def _score(session: _Session, state: State) -> None:
    """Scores the averaged generator on the validation split, and saves it if it is the best so far or has no score."""
    validation = session.validation
    if validation is None or session.metrics_log is None:
        return
    found, measure = validation.score(state.averaged), validation.measure
    if not all(map(math.isfinite, found.values())):
        raise _not_finite(session, state)
    session.metrics_log.add_image(state.step, "learned above truth", validation.picture(state.averaged))
    session.metrics_log.write(state.step, {**found, "seconds": state.seconds})
    state.history.append({"step": state.step, "seconds": state.seconds})
    score = None
    if measure is not None:
        score, rank = found[measure], found.get("rank", found[measure])
        state.history[-1] |= {measure: score, "rank": rank}
        if any(rank < entry.get("rank", rank) for entry in state.history):
            return
        state.best = (score, state.step)
    save_generator(session.run / MODEL, state.averaged, session.config.generator, score)


def _save(session: _Session, state: State, diagnostics: Diagnostics, *, scored: bool = False) -> None:
    """Writes a checkpoint. While no score has chosen a model, the generator of the checkpoint is the model.

    Args:
        scored: since the checkpoint of this step was written, if it was.
    """
    _require_finite(session, state, diagnostics)
    if not session.first:
        return
    if session.validation is None or not state.history:
        save_generator(session.run / MODEL, state.averaged, session.config.generator, None)
    if scored or not checkpoint_path(session.run, state.step).is_dir():
        state.save(session.run)


def _finish(session: _Session, state: State, diagnostics: Diagnostics) -> None:
    """Writes the last score and checkpoint."""
    _require_finite(session, state, diagnostics)
    scores = len(state.history)
    if session.first and (not state.history or state.history[-1]["step"] != state.step):
        _score(session, state)
    _save(session, state, diagnostics, scored=len(state.history) > scores)


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
