"""The score of a generator, `recovered`: how much of the ground-truth layers it found, on texels that pictures show.

`recovered = 1 - E(generator) / E(constant)` is a skill score: 1 is perfect, 0 is no better than one colour everywhere.
`E` is the mean absolute error of the composited base colour over seen texels of learnable parts, weighted by surface
area. *constant* is the one RGBA layer that minimises E on the training subjects.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.errors import AssetError
from svbrdfgan.io import srgb_from_linear
from svbrdfgan.rendering.compositing import RGBA, bare_maps, composite
from svbrdfgan.types.material import CHANNELS

SeenTexels = Callable[[int], Float[Tensor, "rows cols"]]
"""Maps an exemplar's index to a texture that is positive where its picture shows the outermost learnable surface."""

_CONSTANT_TARGETS = 64
POLE_DEGREES = 30.0
"""Within this angle of a pole the hemispherical map stretches circles around the pole more than twofold."""


@dataclass(frozen=True, eq=False)
class Target:
    """The true layer of one exemplar, and where it is scored.

    Attributes:
        subject: index among the exemplars' subjects.
        truth: G0's layer.
        base: base colour under the layer, and the values of the further maps that the layer paints.
        weight: area in square metres of each scored texel; zero elsewhere.
        maps: names of those further maps.
    """

    subject: int
    truth: Float[Tensor, "rows cols channels"]
    base: Float[Tensor, "rows cols values"]
    weight: Float[Tensor, "rows cols"]
    maps: tuple[str, ...] = ()

    def error(self, layer: Float[Tensor, "*#size channels"]) -> Float[Tensor, ""]:
        """E of a layer."""
        return self.errors(layer)[0]

    def errors(self, layer: Float[Tensor, "*#size channels"]) -> Float[Tensor, " maps"]:
        """E of a layer, followed by the error of each further map."""
        difference = (composite(self.base, layer) - composite(self.base, self.truth)).abs()
        channels = [CHANNELS[name] for name in ("base_color", *self.maps)]
        maps = torch.stack([values.mean(dim=-1) for values in difference.split(channels, dim=-1)])
        return (maps * self.weight).sum(dim=(1, 2)) / self.weight.sum()


def make_targets(
    exemplars: Exemplars, seen: SeenTexels, device: torch.device, limit: int | None = None
) -> tuple[list[Target], float]:
    """Targets of at most `limit` exemplars with known layers, evenly chosen, and the seen share of learnable area.

    A texel is scored if any picture of its subject shows it.

    Raises:
        AssetError: no exemplar has a known layer, or none shows a learnable texel.
    """
    views = [view for number in range(len(exemplars.subjects)) for view in exemplars.views_of(number)]
    known = list(filter(exemplars.weathered, views))
    if limit is not None and len(known) > limit:
        known = [known[int(i)] for i in torch.linspace(0, len(known) - 1, limit)]
    targets, shares = [], []
    for number, chosen in groupby(known, key=lambda view: int(exemplars.subject_of[view])):
        subject = exemplars.subjects[number]
        shown = torch.stack([seen(view).cpu() > 0 for view in exemplars.views_of(number)]).any(dim=0)
        area = subject.buffer.area * subject.learnable_texels
        weight = area * shown
        shares.append(float(weight.sum() / area.sum().clamp(min=1e-12)))
        if weight.sum() > 0:
            targets += [_target(exemplars, view, weight.to(device)) for view in chosen]
    if not targets:
        raise AssetError(
            "nothing can be scored: no exemplar that shows a learnable part has a known layer (imported pictures have "
            "none)."
        )
    return targets, sum(shares) / len(shares)


def _target(exemplars: Exemplars, view: int, weight: Float[Tensor, "rows cols"]) -> Target:
    scene, truth = exemplars.scenes[view], exemplars.layers[view]
    assert truth is not None
    albedo = exemplars.subject(view).base_albedo(scene.materials)
    bare = [values.expand(*albedo.shape[:2], -1) for values in bare_maps(scene.maps).values()]
    base, subject = torch.cat([albedo, *bare], dim=-1).to(weight.device), int(exemplars.subject_of[view])
    return Target(subject, truth.to(weight.device), base, weight, tuple(scene.maps))


def mean_errors(targets: Sequence[Target], layers: Float[Tensor, "subjects rows cols channels"]) -> list[float]:
    """Mean E over all targets, with one layer for each subject, followed by the mean error of each further map."""
    with torch.no_grad():
        return torch.stack([target.errors(layers[target.subject]) for target in targets]).mean(dim=0).tolist()


def mean_error(targets: Sequence[Target], layers: Float[Tensor, "subjects rows cols channels"]) -> float:
    """Mean E over all targets, with one layer for each subject."""
    return mean_errors(targets, layers)[0]


def best_constant(targets: Sequence[Target], steps: int = 400) -> Float[Tensor, " channels"]:
    """The constant layer of least E on these targets; in further maps, the alpha-weighted mean of the true layers."""
    device = targets[0].truth.device
    truth = torch.stack([target.truth for target in targets])
    base = torch.stack([target.base[..., :3] for target in targets])
    weight = torch.stack([target.weight / target.weight.sum() for target in targets])
    albedo = composite(base, truth)
    picked = (weight > 0).flatten()
    base, albedo, weight = base.reshape(-1, 3)[picked], albedo.reshape(-1, 3)[picked], weight.flatten()[picked]
    truth = truth.flatten(0, 2)[picked]
    mean = (truth[:, :RGBA] * weight[:, None]).sum(0) / weight.sum()
    laid = weight * truth[:, 3]
    further = (truth[:, RGBA:] * laid[:, None]).sum(0) / laid.sum().clamp(min=1e-12)
    logits = torch.logit(mean.clamp(0.01, 0.99)).to(device).requires_grad_(True)
    adam = torch.optim.Adam([logits], lr=0.05)
    best = (float("inf"), mean)
    for step in range(steps):
        adam.param_groups[0]["lr"] = 0.05 * (1 - step / steps)
        layer = torch.sigmoid(logits)
        error = ((composite(base, layer) - albedo).abs().mean(dim=-1) * weight).sum() / len(targets)
        if float(error.detach()) < best[0]:
            best = (float(error.detach()), layer.detach().clone())
        adam.zero_grad()
        error.backward()
        adam.step()
    return torch.cat([best[1], further])


def constant_layer(exemplars: Exemplars, seen: SeenTexels, device: torch.device) -> Float[Tensor, " channels"]:
    """The constant layer of least E on at most 64 of these exemplars, evenly chosen.

    Raises:
        AssetError: as `make_targets`.
    """
    return best_constant(make_targets(exemplars, seen, device, _CONSTANT_TARGETS)[0])


def near_poles(geometry: Float[Tensor, "subjects 6 rows cols"]) -> Bool[Tensor, "subjects rows cols"]:
    """Texels near the poles of the hemispherical map (thesis 4.1), in any embedding: a vehicle's nose and tail.

    Seen from the centre of the ground, they lie within `POLE_DEGREES` of the long axis (+Z and -Z).
    """
    position = geometry[:, :3]
    return position[:, 2].abs() >= math.cos(math.radians(POLE_DEGREES)) * position.norm(dim=1)


@dataclass(frozen=True, eq=False)
class Scorer:
    """Scores generators on the subjects of a split.

    Attributes:
        geometry: the generator's input for each subject.
        targets: the true layers.
        constant_error: E of the constant layer.
        seen: share of the learnable area that pictures show.
    """

    geometry: Float[Tensor, "subjects 6 rows cols"]
    targets: list[Target]
    constant_error: float
    seen: float

    @classmethod
    def make(
        cls, exemplars: Exemplars, seen: SeenTexels, constant: Float[Tensor, " channels"], device: torch.device
    ) -> Scorer:
        """A scorer of these exemplars, against the constant layer of the training subjects."""
        targets, share = make_targets(exemplars, seen, device)
        geometry = torch.stack([subject.geometry for subject in exemplars.subjects]).to(device)
        size = (len(geometry), *geometry.shape[2:], -1)
        return cls(geometry, targets, mean_error(targets, constant.to(device).expand(size)), share)

    def at_poles(self, constant: Float[Tensor, " channels"]) -> Scorer | None:
        """A scorer of the texels near the poles alone; None if none is scored there."""
        near = near_poles(self.geometry)
        masked = [replace(target, weight=target.weight * near[target.subject]) for target in self.targets]
        targets = [target for target in masked if target.weight.sum() > 0]
        if not targets:
            return None
        size = (len(self.geometry), *self.geometry.shape[2:], -1)
        return replace(self, targets=targets, constant_error=mean_error(targets, constant.expand(size)))

    def layers(
        self, generator: Callable[[Tensor], Tensor], batch: int = 8
    ) -> Float[Tensor, "subjects rows cols channels"]:
        """The layer that a generator paints on each subject."""
        with torch.no_grad():
            return torch.cat([generator(chunk).float() for chunk in self.geometry.split(batch)])

    def picture(
        self, layers: Float[Tensor, "subjects rows cols channels"], count: int = 6
    ) -> Float[Tensor, "height width 3"]:
        """The first subjects' layers over grey, side by side, above the truth; sRGB, v upwards."""
        first = {target.subject: target.truth for target in reversed(self.targets)}
        chosen = sorted(first)[:count]
        learned, truth = layers[chosen], torch.stack([first[subject] for subject in chosen])
        rows = [composite(torch.full_like(x[..., :3], 0.2), x).flip(1) for x in (learned, truth)]
        return srgb_from_linear(torch.cat([torch.cat(list(row), dim=1) for row in rows]).cpu())

    def recovered(self, generator: Callable[[Tensor], Tensor]) -> float:
        """1 - E(generator) / E(constant)."""
        return self.recovered_by(self.layers(generator))

    def recovered_by(self, layers: Float[Tensor, "subjects rows cols channels"]) -> float:
        """1 - E(layers) / E(constant)."""
        return 1.0 - mean_error(self.targets, layers) / self.constant_error
