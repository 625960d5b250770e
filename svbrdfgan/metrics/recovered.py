"""The score of a generator, `recovered`: how much of the ground-truth layers it found, on texels that pictures show.

`recovered = 1 - E(generator) / E(constant)` is a skill score: 1 is perfect, 0 is no better than one colour everywhere.
`E` is the mean error of a map of the composited material over seen texels of learnable parts, weighted by surface area:
the absolute error, and of normals the angle. Further maps than base_color count where they can be observed, if that is
known. *constant* is the constant layer that minimises the map's E on the training subjects.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from typing import TYPE_CHECKING

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from svbrdfgan.errors import AssetError
from svbrdfgan.io.image import srgb_from_linear
from svbrdfgan.metrics.map_errors import LEAST_ERRORS, map_error
from svbrdfgan.networks.inputs import Inputs
from svbrdfgan.rendering.compositing import bare_maps, composite, composite_maps
from svbrdfgan.types import Layer

if TYPE_CHECKING:
    from svbrdfgan.data.exemplars import Exemplars

SeenTexels = Callable[[int], Float[Tensor, "rows cols"]]
"""Maps an exemplar's index to a texture that is positive where its picture shows the outermost learnable surface."""

Observed = Callable[[int], Mapping[str, Bool[Tensor, "rows cols"]]]
"""Maps a subject's number to the texels where each further map can be observed in its pictures."""

_LEAST_SCORE = -1.0
POLE_DEGREES = 30.0
"""Within this angle of a pole the hemispherical map stretches circles around the pole more than twofold."""


@dataclass(frozen=True, eq=False)
class Target:
    """The true layer of one exemplar, and where it is scored.

    Attributes:
        subject: index among the exemplars' subjects.
        truth: G0's layer, with the further maps that are scored.
        base: base colour under the layer, and the further maps that the layer paints.
        weight: area in square metres of each scored texel; zero elsewhere.
        observed: the weights of further maps that are scored on fewer texels.
    """

    subject: int
    truth: Layer
    base: Mapping[str, Float[Tensor, "rows cols values"]]
    weight: Float[Tensor, "rows cols"]
    observed: Mapping[str, Float[Tensor, "rows cols"]] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """The maps that the layer paints, in the order of `CHANNELS`."""
        return ("base_color", *self.truth.maps)

    def errors(self, layer: Float[Tensor, "*#size channels"]) -> Float[Tensor, " maps"]:
        """E of a layer in each map; NaN in one that is observed nowhere."""
        painted = replace(self.truth, values=layer)
        made, true = (composite_maps(self.base, each) for each in (painted, self.truth))
        return torch.stack([self._mean(name, made[name], true[name]) for name in self.names])

    def within(self, region: Bool[Tensor, "rows cols"]) -> Target:
        """The same target, scored in a region of the texture alone."""
        observed = {name: weight * region for name, weight in self.observed.items()}
        return replace(self, weight=self.weight * region, observed=observed)

    def _mean(self, name: str, made: Tensor, truth: Tensor) -> Float[Tensor, ""]:
        weight = self.observed.get(name, self.weight)
        return (map_error(name, made, truth) * weight).sum() / weight.sum()


def make_targets(
    exemplars: Exemplars,
    seen: SeenTexels,
    device: torch.device,
    limit: int | None = None,
    observed: Observed | None = None,
) -> tuple[list[Target], dict[str, float]]:
    """Targets of at most `limit` exemplars with known layers, evenly chosen, and each map's scored share of their area.

    A texel is scored if any picture of its subject shows it; in a further map, if it can be observed there, too.

    Raises:
        AssetError: no exemplar has a known layer, or none shows a learnable texel.
    """
    views = [view for number in range(len(exemplars.subjects)) for view in exemplars.views_of(number)]
    known = list(filter(exemplars.weathered, views))
    if limit is not None and len(known) > limit:
        known = [known[int(i)] for i in torch.linspace(0, len(known) - 1, limit)]
    targets: list[Target] = []
    shares: list[dict[str, float]] = []
    for number, chosen in groupby(known, key=lambda view: int(exemplars.subject_of[view])):
        subject = exemplars.subjects[number]
        shown = shown_texels(exemplars, seen, number)
        area = subject.buffer.area * subject.learnable_texels
        weight = area * shown
        masks = {} if observed is None else observed(number)
        further = {name: weight * mask for name, mask in masks.items()}
        weights = dict.fromkeys(("base_color", *exemplars.scenes[0].maps), weight) | further
        shares.append({name: float(w.sum() / area.sum().clamp(min=1e-12)) for name, w in weights.items()})
        if weight.sum() > 0:
            targets += [_target(exemplars, view, weight.to(device), further) for view in chosen]
    if not targets:
        raise AssetError(
            "nothing can be scored: no exemplar that shows a learnable part has a known layer (imported pictures have "
            "none)."
        )
    return targets, {name: sum(share[name] for share in shares) / len(shares) for name in shares[0]}


def shown_texels(exemplars: Exemplars, seen: SeenTexels, number: int) -> Bool[Tensor, "rows cols"]:
    """The texels of a subject that any of its pictures shows."""
    return torch.stack([seen(view).cpu() > 0 for view in exemplars.views_of(number)]).any(dim=0)


def _target(
    exemplars: Exemplars, view: int, weight: Float[Tensor, "rows cols"], further: Mapping[str, Tensor]
) -> Target:
    scene, truth = exemplars.scenes[view], exemplars.layers[view]
    assert truth is not None
    albedo, device = exemplars.subject(view).base_albedo(scene.materials), weight.device
    bare = {name: values.expand(*albedo.shape[:2], -1) for name, values in bare_maps(scene.maps).items()}
    base = {name: values.to(device) for name, values in {"base_color": albedo, **bare}.items()}
    subject, observed = int(exemplars.subject_of[view]), {name: area.to(device) for name, area in further.items()}
    return Target(subject, truth.to(weight.device), base, weight, observed)


def mean_errors(targets: Sequence[Target], layers: Float[Tensor, "subjects rows cols channels"]) -> list[float]:
    """Mean E over all targets in each map, with one layer for each subject; NaN in a map that is observed nowhere."""
    with torch.no_grad():
        return torch.stack([target.errors(layers[target.subject]) for target in targets]).nanmean(dim=0).tolist()


def mean_error(targets: Sequence[Target], layers: Float[Tensor, "subjects rows cols channels"]) -> float:
    """Mean E over all targets in base_color, with one layer for each subject."""
    return mean_errors(targets, layers)[0]


def near_poles(geometry: Float[Tensor, "subjects inputs rows cols"]) -> Bool[Tensor, "subjects rows cols"]:
    """Texels near the poles of the hemispherical map (thesis 4.1), in any embedding: a vehicle's nose and tail.

    Seen from the centre of the ground, they lie within `POLE_DEGREES` of the long axis (+Z and -Z).
    """
    position = geometry[:, :3]
    return position[:, 2].abs() >= math.cos(math.radians(POLE_DEGREES)) * position.norm(dim=1)


@dataclass(frozen=True, eq=False)
class Scorer:
    """Scores generators on the subjects of a split.

    Attributes:
        inputs: the generator's for each subject.
        targets: the true layers.
        constant_errors: for each map, base_color first, E of its constant layer.
        shares: for each map, the share of the learnable area that is scored: that pictures show, and where the map can
            be observed.
    """

    inputs: Inputs
    targets: list[Target]
    constant_errors: dict[str, float]
    shares: dict[str, float] = field(default_factory=dict)

    @classmethod
    def make(
        cls,
        exemplars: Exemplars,
        seen: SeenTexels,
        constants: Float[Tensor, "maps channels"],
        device: torch.device,
        observed: Observed | None = None,
    ) -> Scorer:
        """A scorer of these exemplars, against the constant layers of the training subjects."""
        targets, shares = make_targets(exemplars, seen, device, observed=observed)
        inputs = Inputs.joined([subject.inputs for subject in exemplars.subjects]).to(device)
        return cls(inputs, targets, _constant_errors(targets, constants, inputs.geometry), shares)

    def at_poles(self, constants: Float[Tensor, "maps channels"]) -> Scorer | None:
        """A scorer of the texels near the poles alone; None if none is scored there."""
        near = near_poles(self.inputs.geometry)
        masked = [target.within(near[target.subject]) for target in self.targets]
        targets = [target for target in masked if target.weight.sum() > 0]
        if not targets:
            return None
        return replace(
            self, targets=targets, constant_errors=_constant_errors(targets, constants, self.inputs.geometry)
        )

    def layers(
        self, generator: Callable[[Inputs], Tensor], batch: int = 8
    ) -> Float[Tensor, "subjects rows cols channels"]:
        """The layer that a generator paints on each subject."""
        with torch.no_grad():
            chunks = [self.inputs.pick(slice(n, n + batch)) for n in range(0, len(self.inputs), batch)]
            return torch.cat([generator(chunk).float() for chunk in chunks])

    def picture(
        self, layers: Float[Tensor, "subjects rows cols channels"], count: int = 6
    ) -> Float[Tensor, "height width 3"]:
        """The first subjects' layers over grey, side by side, above the truth; sRGB, v upwards."""
        first = {target.subject: target.truth for target in reversed(self.targets)}
        chosen = sorted(first)[:count]
        shown = [
            replace(first[chosen[0]], values=layers[chosen]),
            replace(first[chosen[0]], values=torch.stack([first[subject].values for subject in chosen])),
        ]
        rows = [composite(torch.full_like(x.base_color, 0.2), x).flip(1) for x in shown]
        return srgb_from_linear(torch.cat([torch.cat(list(row), dim=1) for row in rows]).cpu())

    def recovered_by(self, layers: Float[Tensor, "subjects rows cols channels"]) -> float:
        """1 - E(layers) / E(constant) in base_color."""
        return 1.0 - mean_error(self.targets, layers) / self.constant_errors["base_color"]

    def errors_by(self, layers: Float[Tensor, "subjects rows cols channels"]) -> dict[str, float]:
        """E of layers in each map; NaN in one that is observed nowhere."""
        return dict(zip(self.constant_errors, mean_errors(self.targets, layers), strict=True))

    def each_recovered_by(self, layers: Float[Tensor, "subjects rows cols channels"]) -> dict[str, float | None]:
        """1 - E(layers) / E(constant) in each map; None where the truth is constant or nothing can be observed."""
        worst = self.constant_errors
        return {
            name: 1.0 - error / worst[name] if worst[name] > LEAST_ERRORS.get(name, 0.0) else None
            for name, error in self.errors_by(layers).items()
        }

    def score(self, layers: Float[Tensor, "subjects rows cols channels"]) -> float:
        """`mean_over_maps` of what layers recovered of each map, by which models are chosen."""
        return mean_over_maps(self.each_recovered_by(layers))


def mean_over_maps(recovered: Mapping[str, float | None]) -> float:
    """The mean of what was recovered of each map that has a score.

    Of several maps, each counts as -1 at least: where a map is nearly constant, small errors are large beside the
    constant's, and would decide alone.
    """
    found = [value for value in recovered.values() if value is not None]
    return found[0] if len(found) == 1 else sum(max(value, _LEAST_SCORE) for value in found) / len(found)


def _constant_errors(
    targets: Sequence[Target],
    constants: Float[Tensor, "maps channels"],
    geometry: Float[Tensor, "subjects inputs rows cols"],
) -> dict[str, float]:
    """E of each map's own constant layer."""
    size = (len(geometry), *geometry.shape[2:], -1)
    rows = [mean_errors(targets, row.to(geometry.device).expand(size)) for row in constants]
    return {name: errors[n] for n, (name, errors) in enumerate(zip(targets[0].names, rows, strict=True))}
