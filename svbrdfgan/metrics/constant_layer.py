"""The baseline of `recovered`: for each map, the constant layer that errs least on the training subjects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.metrics.map_errors import map_error
from svbrdfgan.metrics.recovered import SeenTexels, Target, make_targets
from svbrdfgan.rendering.compositing import composite_maps
from svbrdfgan.types import Layer

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
    mean, rows = texels.mean_layer(), []
    for name in targets[0].names:
        row = replace(mean, values=mean.values.clone())
        least = _least(name, torch.cat([mean[name], mean["alpha"]]), texels, steps)
        row[name][:], row["alpha"][:] = least[:-1], least[-1:]
        rows.append(row.values)
    return torch.stack(rows)


@dataclass(frozen=True, eq=False)
class _Texels:
    """The scored texels of several targets; the weights of each target add up to one."""

    truth: Layer
    base: Mapping[str, Float[Tensor, "texels values"]]
    composited: Mapping[str, Float[Tensor, "texels values"]]
    weight: Float[Tensor, " texels"]
    targets: int

    @classmethod
    def of(cls, targets: Sequence[Target]) -> _Texels:
        weight = torch.stack([target.weight / target.weight.sum() for target in targets]).flatten()
        scored = weight > 0

        def joined(textures: Sequence[Tensor]) -> Tensor:
            return torch.stack(list(textures)).flatten(0, 2)[scored]

        truth = Layer(joined([target.truth.values for target in targets]), targets[0].truth.maps)
        base = {name: joined([target.base[name] for target in targets]) for name in targets[0].names}
        return cls(truth, base, composite_maps(base, truth), weight[scored], len(targets))

    def mean_layer(self) -> Layer:
        """The mean of the true layers; in further maps, weighted by alpha."""
        mean = (self.truth.rgba * self.weight[:, None]).sum(0) / self.weight.sum()
        laid = self.weight * self.truth.alpha
        further = (self.truth.further * laid[:, None]).sum(0) / laid.sum().clamp(min=1e-12)
        return Layer(torch.cat([mean, further]), self.truth.maps)


def _least(name: str, start: Tensor, texels: _Texels, steps: int) -> Tensor:
    """The values of a map, and the alpha, of the constant layer that errs least; by Adam from `start`."""
    base, truth = texels.base[name], texels.composited[name]
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
