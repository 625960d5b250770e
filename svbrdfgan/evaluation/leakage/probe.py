"""The shortcut probe from a training configuration to its diagnosis."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from lightning_fabric import Fabric
from torch import Tensor

from svbrdfgan.data.exemplars import Exemplars, load_exemplars
from svbrdfgan.data.index import DatasetPlan
from svbrdfgan.errors import ConfigError
from svbrdfgan.evaluation.leakage.classifier import Margins, Roles, Trial
from svbrdfgan.evaluation.leakage.confounders import NUISANCES, REMEDIES, Nuisance, differences
from svbrdfgan.evaluation.leakage.rendered_pairs import Darkroom, Differing
from svbrdfgan.evaluation.leakage.report import Diagnosis, Finding
from svbrdfgan.io import save_image
from svbrdfgan.rendering.compositing import over
from svbrdfgan.scene.loader import resolve_renderer
from svbrdfgan.training.batches import require_possible
from svbrdfgan.training.config import TrainConfig, settled
from svbrdfgan.training.trainer import require_device
from svbrdfgan.utils.display import Display, Silent

PAIRS = "pairs.png"
_MOST = 1024
_SHOWN = 8


@dataclass(frozen=True, eq=False)
class Probed:
    """A diagnosis and a picture of it.

    Attributes:
        pairs: the judged pairs that were told most surely, linear: above, the exemplars' clean twins; below, the fakes.
    """

    diagnosis: Diagnosis
    pairs: Float[Tensor, "height width 3"]

    def save(self, folder: Path) -> None:
        """Writes `probe.json` and `pairs.png`."""
        self.diagnosis.save(folder)
        save_image(folder / PAIRS, self.pairs)


def probe_shortcuts(
    config: TrainConfig, *, base: Path = Path(), minutes: float | None = None, display: Display | None = None
) -> Probed:
    """Finds what a discriminator could tell real from fake by, were there no texture to look at.

    It is trained on clean, unweathered renders: in the exemplars' own scenes, and in those in which training would show
    fakes. Then once more for each nuisance that differs, with the others taken away. At most 1024 exemplars, evenly
    chosen, are rendered. Light transports that training will want are stored for it.

    Args:
        base: the folder that paths of the configuration are relative to.
        minutes: about the most that all probes may learn; what they find then depends on the machine.

    Raises:
        ConfigError: there are fewer than five exemplars, they are imported pictures, or the renderer cannot do what is
            asked.
        AssetError: the data set is missing, not finished, or damaged.
    """
    began, shown = time.monotonic(), display or Silent()
    darkroom, how = _open(config, base, shown)
    roles = Roles.deal([int(darkroom.exemplars.subject_of[index]) for index in darkroom.chosen], config.seed)
    everything = frozenset(how)
    shown.begin("clean pictures of both sides")
    trials = {
        differing: Trial(darkroom.config, *darkroom.pair(differing), roles)
        for differing in (everything, *(frozenset({name}) for name in how))
    }
    pictured = time.monotonic()
    margins = _judge(trials, minutes, shown)
    diagnosis = Diagnosis(
        dataset=config.dataset,
        seed=config.seed,
        exemplars=len(darkroom.chosen),
        judged=len(roles.judge),
        together=Finding.of("; ".join(how.values()), margins[everything]),
        alone={name: _alone(name, how, margins) for name in NUISANCES},
        pictures_seconds=pictured - began,
        learning_seconds=time.monotonic() - pictured,
    )
    return Probed(diagnosis, _easiest(trials[everything], margins[everything]))


def _open(config: TrainConfig, base: Path, display: Display) -> tuple[Darkroom, dict[Nuisance, str]]:
    """What makes the pictures, and in what they differ."""
    require_device(config.device)
    device = Fabric(accelerator=config.device, devices=1).device
    folder = (base / config.dataset).resolve()
    plan = DatasetPlan.load(folder)
    config = settled(config, plan.config.spp)
    trained_with, chosen_renderer = resolve_renderer(config.renderer, device, plan.config.maps, differentiable=True)
    require_possible(config, plan, trained_with)
    exemplars = load_exemplars(folder, "train")
    recorded = exemplars.scenes[0].renderer
    made_with = trained_with if recorded == chosen_renderer else resolve_renderer(recorded, device)[0]
    _require_known(exemplars)
    chosen = np.unique(np.linspace(0, len(exemplars) - 1, min(len(exemplars), _MOST)).round().astype(int)).tolist()
    darkroom = Darkroom(config, exemplars, chosen, trained_with, made_with, device, base, display.advance)
    return darkroom, differences(config, plan.config, made_with, trained_with)


def _judge(trials: dict[Differing, Trial], minutes: float | None, display: Display) -> dict[Differing, Margins]:
    """The margins of each trial. What time one leaves over is for the others."""
    margins: dict[Differing, Margins] = {}
    began = time.monotonic()
    display.begin("probes", len(trials))
    for differing, trial in trials.items():
        left = len(trials) - len(margins)
        seconds = None if minutes is None else (60 * minutes - (time.monotonic() - began)) / left
        margins[differing] = trial.judge(seconds)
        display.advance()
    return margins


def _require_known(exemplars: Exemplars) -> None:
    if any(scene.weathering == "unknown" for scene in exemplars.scenes):
        raise ConfigError(
            "the exemplars are imported pictures, which nobody can show unweathered: probe a data set of renders "
            "with cameras and lights like theirs instead."
        )


def _alone(name: Nuisance, how: dict[Nuisance, str], margins: dict[Differing, Margins]) -> Finding:
    if name not in how:
        return Finding(differs="")
    return Finding.of(how[name], margins[frozenset({name})], REMEDIES[name])


def _easiest(trial: Trial, margins: Margins) -> Float[Tensor, "height width 3"]:
    """The pairs of the largest margins, before grey, the most telling first."""
    best = [trial.roles.judge[place] for place in margins.argsort(descending=True)[:_SHOWN].tolist()]
    rows, grey = [], torch.full((3,), 0.5)
    for stills in (trial.real, trial.fake):
        image, coverage, _ = stills.shot(best)
        rows.append(torch.cat(over(image.float().cpu(), coverage.float().cpu(), grey).unbind(), dim=1))
    return torch.cat(rows)
