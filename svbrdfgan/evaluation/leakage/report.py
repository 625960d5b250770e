"""The leakage report: what the probe found, in numbers and in words."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Literal

from jaxtyping import Float
from torch import Tensor

from svbrdfgan.config.models import StrictModel
from svbrdfgan.evaluation.leakage.confounders import Confounder
from svbrdfgan.io.records import save_record

REPORT = "probe.json"
_DEVIATIONS = 2.5758
"""99 % of a normal distribution lie within this many standard deviations."""


class Share(StrictModel):
    """The share of pairs in which the classifiers picked the exemplar's picture; a tie is half a pick; 0.5 is chance.

    Attributes:
        low, high: the 99 % interval (Wilson 1927). Where nothing differs, every pick is a coin toss, so one matched
            configuration in two hundred appears to leak.
    """

    value: float
    low: float
    high: float
    pairs: int

    @classmethod
    def of(cls, margins: Float[Tensor, " pairs"]) -> Share:
        """The share by the classifiers' margins: how much more real each exemplar's picture looked than its fake."""
        count, square = len(margins), _DEVIATIONS**2
        value = float(((margins > 0) + 0.5 * (margins == 0)).double().mean())
        centre = value + square / (2 * count)
        spread = math.sqrt(value * (1 - value) * square / count + (square / (2 * count)) ** 2)
        low, high = ((centre + side * spread) / (1 + square / count) for side in (-1, 1))
        return cls(value=value, low=low, high=high, pairs=count)

    @property
    def leaks(self) -> bool:
        """Whether the share is above chance."""
        return self.low > 0.5

    @property
    def verdict(self) -> str:
        """The result in words."""
        return f"{'leaks' if self.leaks else 'no leak'}: {self.value:.0%}"


class Finding(StrictModel):
    """The result for one confounder alone, or for all together.

    Attributes:
        differs: how real and fake differ; empty where they do not.
        share: None where nothing differs.
        remedy: what helps, if it leaks.
    """

    differs: str
    share: Share | None = None
    verdict: str = "the same on both sides"
    remedy: str | None = None

    @classmethod
    def of(cls, differs: str, margins: Float[Tensor, " pairs"], remedy: str | None = None) -> Finding:
        """The finding from the classifiers' margins."""
        share = Share.of(margins)
        return cls(differs=differs, share=share, verdict=share.verdict, remedy=remedy if share.leaks else None)


class LeakageReport(StrictModel):
    """The contents of `probe.json`.

    Attributes:
        layers: what both sides showed: no layer, or the exemplars' true ones.
        exemplars: number of scenes rendered. The classifiers were judged on `judged` of them and learned from the rest.
        together: all confounders of the configuration at once, as training would show them.
        alone: each confounder with the others removed.
        pictures_seconds, learning_seconds: time taken.
    """

    dataset: str
    seed: int
    layers: Literal["none", "true"] = "none"
    exemplars: int
    judged: int
    together: Finding
    alone: dict[Confounder, Finding]
    pictures_seconds: float
    learning_seconds: float

    def lines(self) -> list[str]:
        """One line for each confounder that tells the sides apart, or a line that none does."""
        found = [f"{name} {f.verdict}. {f.remedy}" for name, f in self.alone.items() if f.remedy]
        if found:
            return found
        if self.together.share and self.together.share.leaks:
            share = f"{self.together.share.value:.0%}"
            return [f"All together tell {share} of pairs, though none leaks alone: match more of them."]
        bound = f" that tells more than {self.together.share.high:.0%} of pairs" if self.together.share else ""
        return [f"No shortcut was found{bound}."]

    def save(self, folder: Path) -> None:
        save_record(folder / REPORT, self)
