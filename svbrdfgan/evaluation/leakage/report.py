"""What probes found, in numbers and in words."""

from __future__ import annotations

import math
from pathlib import Path

from jaxtyping import Float
from torch import Tensor

from svbrdfgan.config.models import StrictModel
from svbrdfgan.evaluation.leakage.confounders import Nuisance
from svbrdfgan.io.records import save_record

DIAGNOSIS = "probe.json"
_DEVIATIONS = 2.5758
"""Within so many of them lie 99 % of a normal distribution."""


class Share(StrictModel):
    """The share of pairs in which a probe picked the exemplar's picture, a tie counted as half a pick; 0.5 is chance.

    Attributes:
        low, high: the 99 % interval (Wilson 1927). Where nothing differs every pick is the toss of a coin, whatever the
            probe has learned; so one matched configuration in two hundred seems to be told.
    """

    value: float
    low: float
    high: float
    pairs: int

    @classmethod
    def of(cls, margins: Float[Tensor, " pairs"]) -> Share:
        """From how much more real each exemplar's picture looked."""
        count, square = len(margins), _DEVIATIONS**2
        value = float(((margins > 0) + 0.5 * (margins == 0)).double().mean())
        centre = value + square / (2 * count)
        spread = math.sqrt(value * (1 - value) * square / count + (square / (2 * count)) ** 2)
        low, high = ((centre + side * spread) / (1 + square / count) for side in (-1, 1))
        return cls(value=value, low=low, high=high, pairs=count)

    @property
    def told(self) -> bool:
        """Whether it is more than chance."""
        return self.low > 0.5

    @property
    def verdict(self) -> str:
        """In words."""
        return f"{'can be' if self.told else 'not'} told: {self.value:.0%}"


class Finding(StrictModel):
    """What came of one nuisance alone, or of all together.

    Attributes:
        differs: how real and fake differ in it; empty where they do not.
        share: None where nothing differs, and so nothing was tried.
        remedy: what helps, where it can be told.
    """

    differs: str
    share: Share | None = None
    verdict: str = "the same on both sides"
    remedy: str | None = None

    @classmethod
    def of(cls, differs: str, margins: Float[Tensor, " pairs"], remedy: str | None = None) -> Finding:
        """From a probe's margins."""
        share = Share.of(margins)
        return cls(differs=differs, share=share, verdict=share.verdict, remedy=remedy if share.told else None)


class Diagnosis(StrictModel):
    """The contents of `probe.json`.

    Attributes:
        exemplars: whose scenes were probed; the probes were judged on `judged` of them, and learned from the others.
        together: all that differs under the configuration at once, as training would show it.
        alone: each nuisance with the others taken away.
        pictures_seconds, learning_seconds: how long it took.
    """

    dataset: str
    seed: int
    exemplars: int
    judged: int
    together: Finding
    alone: dict[Nuisance, Finding]
    pictures_seconds: float
    learning_seconds: float

    def lines(self) -> list[str]:
        """What to tell a user: one line for each nuisance that can be told, or that none can."""
        found = [f"{name} {f.verdict}. {f.remedy}" for name, f in self.alone.items() if f.remedy]
        if found:
            return found
        if self.together.share and self.together.share.told:
            return [f"All together {self.together.verdict}, though no nuisance alone: match more of them."]
        bound = f" that tells more than {self.together.share.high:.0%} of pairs" if self.together.share else ""
        return [f"No shortcut was found{bound}."]

    def save(self, folder: Path) -> None:
        save_record(folder / DIAGNOSIS, self)
