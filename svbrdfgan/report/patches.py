"""What the discriminator thinks, patch by patch (thesis figure 3-2: yellow is real, cyan is fake)."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.errors import SvbrdfganError
from svbrdfgan.networks import Discriminator
from svbrdfgan.report.pictures import Picture
from svbrdfgan.report.vehicles import Titled, Vehicle, subject_name
from svbrdfgan.scoring.evaluate import Evaluated
from svbrdfgan.scoring.flip import display
from svbrdfgan.training.picture import present
from svbrdfgan.training.state import State, checkpoints

CYAN, YELLOW = (0.0, 0.78, 0.86), (1.0, 0.82, 0.05)
_GREY, _TINT = 0.5, 0.72

log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Judged:
    """A real picture and a fake one, display-referred, with the logits of their patches."""

    real: Picture
    fake: Picture
    real_logits: Float[Tensor, "rows cols"]
    fake_logits: Float[Tensor, "rows cols"]


def patch_maps(run: Path, evaluated: Evaluated, indices: Sequence[int]) -> tuple[list[Vehicle], int] | None:
    """Exemplars and renders under the map of the run's latest discriminator, and its step; None where there is none."""
    found = checkpoints(run)
    if not found or not indices:
        return None
    try:
        state = State.fresh(evaluated.config.train, evaluated.feed.buffers.device)
        state.load(found[-1])
    except SvbrdfganError as error:
        log.warning("the discriminator is left out of the report: %s", error)
        return None
    judged = [judge(evaluated, state.discriminator.eval(), index) for index in indices]
    names = [subject_name(evaluated.feed.exemplars.scenes[index]) for index in indices]
    scale = Scale.make(evaluated.config.train.loss.name, judged)
    return [_row(name, pair, scale) for name, pair in zip(names, judged, strict=True)], state.step


def judge(evaluated: Evaluated, discriminator: Discriminator, index: int) -> Judged:
    """Shows the discriminator an exemplar, and the generator's layer in the same scene, as training does."""
    feed, number = evaluated.feed, int(evaluated.feed.exemplars.subject_of[index])
    image, coverage, guide = feed.real([index])
    stage = feed.stage([index], np.random.default_rng(0))
    shown = stage.guide if evaluated.config.train.discriminator.guide else None
    background = torch.full((1, 3), _GREY, device=image.device)
    with torch.no_grad():
        made = stage.render(evaluated.layers["generated"][number : number + 1].to(image.device))
        real = discriminator(present(image, coverage, background, guide))[0].cpu()
        fake = discriminator(present(made, stage.coverage, background, shown))[0].cpu()
    pair = ((image, coverage), (made, stage.coverage))
    first, second = (display(i[0].cpu().float(), _GREY, c[0].cpu().float()) for i, c in pair)
    return Judged(first, second, real, fake)


@dataclass(frozen=True)
class Scale:
    """From logits to how real a patch looks, 0 to 1. A critic's logits have no zero of their own."""

    loss: str
    middle: float
    spread: float

    @classmethod
    def make(cls, loss: str, judged: Sequence[Judged]) -> Scale:
        """The middle between the mean logits of real and fake, and their common deviation."""
        real = torch.cat([pair.real_logits.flatten() for pair in judged])
        fake = torch.cat([pair.fake_logits.flatten() for pair in judged])
        spread = float(torch.cat([real, fake]).std(correction=0).clamp(min=1e-6))
        return cls(loss, float(real.mean() + fake.mean()) / 2, spread)

    def likelihood(self, logits: Tensor) -> Tensor:
        if self.loss == "vanilla":
            return torch.sigmoid(logits)
        if self.loss == "lsgan":
            return logits.clamp(0, 1)
        return torch.sigmoid((logits - self.middle) / self.spread)


def overlay(picture: Picture, real: Float[Tensor, "rows cols"]) -> Picture:
    """The picture in grey under its patches: yellow where they look real, cyan where fake, grey between."""
    height, width = picture.shape[:2]
    patches = F.interpolate(real[None, None], size=(height, width), mode="nearest")[0, 0].unsqueeze(-1)
    sure = (2 * patches - 1).abs()
    color = torch.where(patches > 0.5, torch.tensor(YELLOW), torch.tensor(CYAN))
    luminance = picture[..., :3] @ torch.tensor([0.2126, 0.7152, 0.0722])
    grey = luminance.unsqueeze(-1)
    tinted = grey + _TINT * (color * (0.35 + 0.65 * grey) - grey)
    return grey * (1 - sure) + tinted * sure


def _row(name: str, pair: Judged, scale: Scale) -> Vehicle:
    real, fake = scale.likelihood(pair.real_logits), scale.likelihood(pair.fake_logits)
    shown = (
        Titled("Real", pair.real),
        Titled("judged", overlay(pair.real, real), f"{float(real.mean()):.0%} real"),
        Titled("Fake", pair.fake),
        Titled("judged", overlay(pair.fake, fake), f"{float(fake.mean()):.0%} real"),
    )
    return Vehicle(name, f"{real.shape[0]} × {real.shape[1]} patches", shown)
