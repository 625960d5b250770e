"""Maps of how real each patch looks to the discriminator (thesis figure 3-2: yellow is real, cyan is fake)."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.errors import SvbrdfganError
from svbrdfgan.evaluation.evaluated import Evaluated
from svbrdfgan.io.image import luminance
from svbrdfgan.metrics.flip import display
from svbrdfgan.networks.discriminator import Discriminator
from svbrdfgan.report.pictures import Picture
from svbrdfgan.report.vehicles import Titled, Vehicle, subject_name
from svbrdfgan.training.state import checkpoints, load_discriminator
from svbrdfgan.training.step import make_pair

CYAN = (0.0, 0.78, 0.86)  # fake; sRGB
YELLOW = (1.0, 0.82, 0.05)  # real
_GREY = 0.5  # linear, of the background
_TINT = 0.85  # share of the colour where the discriminator is sure

log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class PatchLogits:
    """A real picture and a fake one, both display-referred, with the logits of their patches."""

    real: Picture
    fake: Picture
    real_logits: Float[Tensor, "rows cols"]
    fake_logits: Float[Tensor, "rows cols"]


@dataclass(frozen=True, eq=False)
class PatchMaps:
    """Pictures under the discriminator's logits at a step; `legend` says what the colours mean."""

    step: int
    legend: str
    vehicles: tuple[Vehicle, ...]


def patch_maps(run: Path, evaluated: Evaluated, indices: Sequence[int]) -> PatchMaps | None:
    """Exemplars and renders under the logits of the run's latest discriminator; None if the run has no checkpoint."""
    found = checkpoints(run)
    if not found or not indices:
        return None
    try:
        config = evaluated.config
        discriminator, step = load_discriminator(found[-1], config.train.discriminator, config.conditions.size)
    except SvbrdfganError as error:
        log.warning("the report has no patch maps: %s", error)
        return None
    discriminator.to(evaluated.source.device)
    judged = [judge(evaluated, discriminator, index) for index in indices]
    names = [subject_name(evaluated.source.exemplars.scenes[index]) for index in indices]
    scale = Scale.make(evaluated.config.train.loss.name, judged)
    return PatchMaps(step, scale.legend, tuple(_row(n, pair, scale) for n, pair in zip(names, judged, strict=True)))


def judge(evaluated: Evaluated, discriminator: Discriminator, index: int) -> PatchLogits:
    """The logits of an exemplar, and of the generator's layer in the same scene with as many samples."""
    source, device = evaluated.source, evaluated.source.device
    layer, background = evaluated.learned(index), torch.full((1, 3), _GREY, device=device)
    octaves = evaluated.config.train.discriminator.octaves
    with torch.no_grad():
        scenes = source.scenes([index], np.random.default_rng(0))
        pair = make_pair(source, [index], scenes, layer.values.unsqueeze(0).to(device))
        real, fake = (discriminator(side.tone_mapped(background, octaves))[0].cpu() for side in pair)
    first, second = (display(side.image[0].cpu().float(), _GREY, side.coverage[0].cpu().float()) for side in pair)
    return PatchLogits(first, second, real, fake)


@dataclass(frozen=True)
class Scale:
    """The scale by which logits become colours.

    Attributes:
        middle: the logit between real and fake. A critic's logits have no such value: then their mean.
        reach: distance from the middle at which colours are full; nearly the largest of all patches.
    """

    loss: str
    middle: float
    reach: float

    @classmethod
    def make(cls, loss: str, judged: Sequence[PatchLogits]) -> Scale:
        """The scale for all these pictures."""
        real = torch.cat([pair.real_logits.flatten() for pair in judged])
        fake = torch.cat([pair.fake_logits.flatten() for pair in judged])
        middle = {"vanilla": 0.0, "lsgan": 0.5}.get(loss, float(real.mean() + fake.mean()) / 2)
        reach = float(torch.quantile((torch.cat([real, fake]) - middle).abs(), 0.98))
        return cls(loss, middle, max(reach, 1e-6))  # all logits may be equal

    @property
    def legend(self) -> str:
        """The meaning of full colour, in a sentence."""
        if self.loss == "vanilla":
            sure = 1 / (1 + math.exp(-self.reach))
            return f"Full colour means {sure:.1%} sure."
        if self.loss == "lsgan":
            return f"Full colour lies {self.reach:.2g} from undecided, on a scale where real is 1 and fake 0."
        far = f"full colour {self.reach:.2g} from it"
        return f"Under the {self.loss} loss logits have no zero of their own: grey is the mean, {far}."

    def leaning(self, logits: Tensor) -> Tensor:
        """The logits on a scale from -1 (fake) to 1 (real)."""
        return ((logits - self.middle) / self.reach).clamp(-1, 1)

    def note(self, logits: Tensor) -> str:
        """The opinion on a whole picture, in a few words."""
        if self.loss == "vanilla":
            return f"{float(torch.sigmoid(logits).mean()):.1%} real"
        return f"mean logit {float(logits.mean()):+.3f}"


def overlay(picture: Picture, leaning: Float[Tensor, "rows cols"]) -> Picture:
    """The picture in grey, tinted by patch: yellow for real, cyan for fake, untinted between."""
    height, width = picture.shape[:2]
    patches = F.interpolate(leaning[None, None], size=(height, width), mode="nearest")[0, 0].unsqueeze(-1)
    grey = luminance(picture[..., :3]).unsqueeze(-1)
    color = torch.where(patches > 0, torch.tensor(YELLOW), torch.tensor(CYAN)) * (0.35 + 0.65 * grey)
    return torch.lerp(grey, color, _TINT * patches.abs())


def _row(name: str, pair: PatchLogits, scale: Scale) -> Vehicle:
    rows, cols = pair.real_logits.shape
    columns = (
        Titled("Real", pair.real),
        Titled("Real, judged", overlay(pair.real, scale.leaning(pair.real_logits)), scale.note(pair.real_logits)),
        Titled("Fake", pair.fake),
        Titled("Fake, judged", overlay(pair.fake, scale.leaning(pair.fake_logits)), scale.note(pair.fake_logits)),
    )
    return Vehicle(name, f"{rows} x {cols} patches", columns)
