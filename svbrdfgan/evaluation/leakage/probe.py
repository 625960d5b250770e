"""The leakage probe, from a training configuration to its report."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.data.exemplars import Exemplars, load_exemplars
from svbrdfgan.errors import ConfigError
from svbrdfgan.evaluation.leakage.classifier import Margins, Roles, Trial
from svbrdfgan.evaluation.leakage.confounders import CONFOUNDERS, REMEDIES, Confounder, find_confounders
from svbrdfgan.evaluation.leakage.rendered_pairs import Confounders, RenderedPairs
from svbrdfgan.evaluation.leakage.report import Finding, LeakageReport
from svbrdfgan.io.image import save_image
from svbrdfgan.plugins.select import resolve_renderer
from svbrdfgan.rendering.compositing import over
from svbrdfgan.training.config import TrainConfig
from svbrdfgan.training.memory import require_run
from svbrdfgan.training.reference_pictures import require_reference_materials
from svbrdfgan.training.resolve import make_fabric, resolve_run
from svbrdfgan.utils.display import Display, SilentDisplay

PAIRS = "pairs.png"
_MOST = 1024
"""The most exemplars that are rendered."""
_SHOWN = 8


@dataclass(frozen=True, eq=False)
class ProbeResult:
    """The findings of a probe, and a picture of them.

    Attributes:
        pairs: the judged pairs with the largest margins, linear: exemplars above, fakes below.
    """

    report: LeakageReport
    pairs: Float[Tensor, "height width 3"]

    def save(self, folder: Path) -> None:
        """Writes `probe.json` and `pairs.png`."""
        self.report.save(folder)
        save_image(folder / PAIRS, self.pairs)


def probe_shortcuts(
    config: TrainConfig,
    *,
    base: Path = Path(),
    true_layers: bool = False,
    minutes: float | None = None,
    display: Display | None = None,
) -> ProbeResult:
    """Finds what a discriminator could tell real from fake by besides the texture.

    The probe trains classifiers on renders of the exemplars' own scenes and of the scenes that training would render
    fakes in, both clean, or both of the exemplars' true layers; then again for each confounder that differs, with the
    others removed. The probe renders at most 1024 exemplars, evenly chosen, and stores the light transports that
    training will need.

    Args:
        base: the folder that paths of the configuration are relative to.
        true_layers: shows the exemplars' true layers on both sides, as a perfect generator would paint them. So the
            probe also finds noise that layers have in fakes.
        minutes: roughly the most time that all classifiers may learn. The result then depends on the machine.

    Raises:
        ConfigError: there are fewer than five exemplars, they are imported pictures, or the renderer cannot do what is
            asked.
        AssetError: the data set is missing, not finished, or damaged.
    """
    began, shown = time.monotonic(), display or SilentDisplay()
    pairs, how = _open(config, base, true_layers, shown)
    roles = Roles.deal([pairs.exemplars.scenes[index].mesh.path for index in pairs.chosen], config.seed)
    everything = frozenset(how)
    wanted = list(dict.fromkeys([everything, *(frozenset({name}) for name in how)]))
    shown.begin("pictures of both sides", pairs.steps(wanted))
    trials = {present: Trial(pairs.run.config, *pairs.render(present), roles) for present in wanted}
    rendered = time.monotonic()
    margins = _judge(trials, minutes, shown)
    report = LeakageReport(
        dataset=config.dataset,
        seed=config.seed,
        layers="true" if true_layers else "none",
        exemplars=len(pairs.chosen),
        judged=len(roles.judge),
        together=Finding.of("; ".join(how.values()), margins[everything]),
        alone={name: _alone(name, how, margins) for name in CONFOUNDERS},
        pictures_seconds=rendered - began,
        learning_seconds=time.monotonic() - rendered,
    )
    return ProbeResult(report, _easiest(trials[everything], margins[everything]))


def _open(
    config: TrainConfig, base: Path, true_layers: bool, display: Display
) -> tuple[RenderedPairs, dict[Confounder, str]]:
    """The pairs, not rendered yet, and the confounders of the configuration, in words."""
    device, run = make_fabric(config.device).device, resolve_run(config, base)
    require_run(run, ("train",), device, learns=False)
    renderer, choice = resolve_renderer(
        config.renderer, device, run.dataset.config.maps, differentiable=True, deferred=run.deferred
    )
    exemplars = load_exemplars(run.dataset, "train", run.config.generator)
    recorded = exemplars.scenes[0].renderer
    exemplar_renderer = renderer if recorded == choice else resolve_renderer(recorded, device)[0]
    _require_known(exemplars)
    if run.config.discriminator.light_buffer:
        require_reference_materials(renderer)
    chosen = np.unique(np.linspace(0, len(exemplars) - 1, min(len(exemplars), _MOST)).round().astype(int)).tolist()
    pairs = RenderedPairs(run, exemplars, chosen, renderer, exemplar_renderer, device, true_layers, display.advance)
    return pairs, find_confounders(run, exemplar_renderer, renderer)


def _judge(trials: dict[Confounders, Trial], minutes: float | None, display: Display) -> dict[Confounders, Margins]:
    """The margins of each trial. Time that one trial leaves is shared by the others."""
    margins: dict[Confounders, Margins] = {}
    began = time.monotonic()
    display.begin("probes", len(trials))
    for present, trial in trials.items():
        left = len(trials) - len(margins)
        seconds = None if minutes is None else (60 * minutes - (time.monotonic() - began)) / left
        margins[present] = trial.judge(seconds)
        display.advance()
    return margins


def _require_known(exemplars: Exemplars) -> None:
    if any(scene.weathering == "unknown" for scene in exemplars.scenes):
        raise ConfigError(
            "the exemplars are imported pictures, which nobody can show unweathered: probe a data set of renders "
            "with cameras and lights like theirs instead."
        )


def _alone(name: Confounder, how: dict[Confounder, str], margins: dict[Confounders, Margins]) -> Finding:
    if name not in how:
        return Finding(differs="")
    return Finding.of(how[name], margins[frozenset({name})], REMEDIES[name])


def _easiest(trial: Trial, margins: Margins) -> Float[Tensor, "height width 3"]:
    """The pairs with the largest margins over grey, largest first."""
    best = [trial.roles.judge[place] for place in margins.argsort(descending=True)[:_SHOWN].tolist()]
    rows, grey = [], torch.full((3,), 0.5)
    for side in (trial.real, trial.fake):
        shown = side.pick(best)
        rows.append(torch.cat(over(shown.image.float().cpu(), shown.coverage.float().cpu(), grey).unbind(), dim=1))
    return torch.cat(rows)
