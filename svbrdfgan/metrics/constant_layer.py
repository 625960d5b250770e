"""The baseline of `recovered`: for each map, the constant layer that errs least on the training subjects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.metrics.map_errors import map_error
from svbrdfgan.metrics.recovered import SeenTexels, Target, make_targets
from svbrdfgan.rendering.compositing import RGBA, composite
from svbrdfgan.types.material import CHANNELS

_TARGETS = 64


def constant_layers(exemplars: Exemplars, seen: SeenTexels, device: torch.device) -> Float[Tensor, "maps channels"]:
    """`best_constants` on at most 64 of these exemplars, evenly chosen, over what their pictures show.

    Raises:
        AssetError: as `make_targets`.
    """
    return best_constants(make_targets(exemplars, seen, device, _TARGETS)[0])


def best_constants(targets: Sequence[Target], steps: int = 400) -> Float[Tensor, "maps channels"]:
    """The constant layer whose composite errs least in each map, base_color first, on these targets.

    What does not enter the error of its map is the mean of the true layers, weighted by alpha.
    """
    texels = _Texels.of(targets)
    mean, rows, first = texels.mean_layer(), [], 0
    for name in targets[0].names:
        values = range(first, first + CHANNELS[name])
        own = [*(value + (value >= 3) for value in values), 3]  # a layer's fourth channel is alpha
        row = mean.clone()
        row[own] = _least(name, mean[own], texels, list(values), steps)
        rows.append(row)
        first += CHANNELS[name]
    return torch.stack(rows)


@dataclass(frozen=True, eq=False)
class _Texels:
    """The scored texels of so many targets; the weights of each target add up to one."""

    truth: Float[Tensor, "texels channels"]
    base: Float[Tensor, "texels values"]
    composited: Float[Tensor, "texels values"]
    weight: Float[Tensor, " texels"]
    targets: int

    @classmethod
    def of(cls, targets: Sequence[Target]) -> _Texels:
        truth = torch.stack([target.truth for target in targets]).flatten(0, 2)
        base = torch.stack([target.base for target in targets]).flatten(0, 2)
        weight = torch.stack([target.weight / target.weight.sum() for target in targets]).flatten()
        truth, base, weight = truth[weight > 0], base[weight > 0], weight[weight > 0]
        return cls(truth, base, composite(base, truth), weight, len(targets))

    def mean_layer(self) -> Float[Tensor, " channels"]:
        """The mean of the true layers; in further maps, weighted by alpha."""
        mean = (self.truth[:, :RGBA] * self.weight[:, None]).sum(0) / self.weight.sum()
        laid = self.weight * self.truth[:, 3]
        further = (self.truth[:, RGBA:] * laid[:, None]).sum(0) / laid.sum().clamp(min=1e-12)
        return torch.cat([mean, further])


def _least(name: str, start: Tensor, texels: _Texels, values: list[int], steps: int) -> Tensor:
    """The values of a map, and the alpha, of the constant layer that errs least; by Adam from `start`."""
    base, truth = texels.base[:, values], texels.composited[:, values]
    lowest = torch.zeros_like(start)
    if name == "normal":
        lowest[:2] = -1.0  # x and y; the other channels, and alpha, are in [0, 1]
    logits = torch.logit(((start - lowest) / (1 - lowest)).clamp(0.01, 0.99)).requires_grad_(True)
    adam = torch.optim.Adam([logits], lr=0.05)
    best = (float("inf"), start)
    for step in range(steps):
        adam.param_groups[0]["lr"] = 0.05 * (1 - step / steps)
        layer = lowest + (1 - lowest) * torch.sigmoid(logits)
        made = base + layer[-1:] * (layer[:-1] - base)
        error = (map_error(name, made, truth) * texels.weight).sum() / texels.targets
        if float(error.detach()) < best[0]:
            best = (float(error.detach()), layer.detach().clone())
        adam.zero_grad()
        error.backward()
        adam.step()
    return best[1]
