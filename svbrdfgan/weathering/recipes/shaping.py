"""What all recipes shape their matter with: noise in metres, ramps, films, mixtures of colours."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.weathering.procedural_noise import Scratches, Spots, fbm, scratches, spots, streaks
from svbrdfgan.weathering.recipes.recipe import Colors, Options, Values
from svbrdfgan.weathering.site import Site

Color = tuple[float, float, float] | Colors

_FINEST = 0.002  # metres: below, nothing is painted
_RESOLVED = 2.5  # texels to the shortest wave


@dataclass(frozen=True, eq=False)
class Run:
    """A run of water at each texel.

    Attributes:
        strength: in [0, 1], 0 where there is none.
        head: from the texel to the run's head, in metres.
        random: numbers in [0, 1) of the run.
    """

    strength: Values
    head: Colors
    random: Float[Tensor, "texels 4"]


class Ground:
    """A site as one recipe sees it: in metres, float32, with the recipe's seed and scale.

    Attributes:
        place: metres from the centre of the model's ground.
        up: metres above the ground.
        texel: metres.
    """

    def __init__(self, recipe: Options, site: Site) -> None:
        self.site, self.recipe = site, recipe
        self.place: Float[Tensor, "texels 3"] = site.position.float() * site.length
        self.up = self.place[:, 1]
        self.normal = site.normal.float()
        self.visibility, self.curvature = site.visibility.float(), site.curvature.float()
        self.convex, self.crease, self.border = site.convex.float(), site.crease.float(), site.border.float()
        self.texel = site.texel * site.length

    def noise(
        self,
        wave: float,
        stream: int,
        *,
        stretch: tuple[float, float, float] = (1.0, 1.0, 1.0),
        finest: float = _FINEST,
        moved: Colors | None = None,
    ) -> Values:
        """Noise from waves of `wave` metres down to `finest` or what texels resolve; standard deviation at most 0.45.

        What texels do not resolve is missing, and the rest is as with finer ones.

        Args:
            stretch: how much longer waves are along x, y and z.
            moved: metres from each texel to where the noise is wanted.
        """
        octaves = 1.0 + math.log2(wave * self.recipe.scale / max(finest, _RESOLVED * self.texel))
        if octaves <= 0.0:
            return torch.zeros_like(self.up)
        whole, part = divmod(octaves, 1.0)
        strength = 2.0 - 0.5 ** (whole - 1.0) * (1.0 - 0.5 * part) if whole else part
        return 1.7 * strength * fbm(self._cells(wave, stretch, moved), self._seed(stream), octaves=octaves)

    def spots(self, cell: float, share: Values, stream: int, *, warp: Colors | None = None, flow: float = 1.0) -> Spots:
        """Round spots, one in each cell of `cell` metres, and none where texels do not resolve them.

        Args:
            share: of the cells that have one, in [0, 1].
            warp: moves each point, in metres, so that spots have ragged outlines.
            flow: how much longer spots are along z.
        """
        share = share * _ramp_number(1.5, 3.0, 0.3 * cell * self.recipe.scale / max(self.texel, 1e-9))
        points = self._cells(cell, (1.0, 1.0, flow), warp)
        return spots(points, share.detach(), self._seed(stream))

    def runs(self, width: float, length: float, share: Values, stream: int) -> list[Run]:
        """Runs of water down steep surfaces, in cells of `width` by `length` metres: on flanks, and on front and tail.

        Args:
            share: of the cells that have a run.
        """
        size = constant((width * self.recipe.scale, -length * self.recipe.scale), self.up.device)
        wander = 0.30 * width * self.noise(0.22, stream + 1, stretch=(1.0, 2.0, 1.0), finest=0.03).detach()
        uneven = (1.0 + 0.5 * self.noise(0.05, stream + 2, stretch=(1.0, 4.0, 1.0)).detach()).clamp(0.0, 1.0)
        sideways = ramp(-0.3, 0.3, self.normal[:, 0].abs() - self.normal[:, 2].abs())
        steep, found = self.steep(), []
        for axis, facing in ((2, sideways), (0, 1.0 - sideways)):
            plane = torch.stack([self.place[:, axis].detach() + wander, self.up.detach()], dim=1) / size
            streak = streaks(plane, share.detach(), self._seed(stream) + axis)
            offset = torch.zeros_like(self.place)
            offset[:, [axis, 1]] = streak.head * size
            found.append(Run(streak.strength * facing * steep * uneven, offset, streak.random))
        return found

    def scratches(self, cell: float, share: Values, stream: int) -> Scratches:
        """Segments of lines, one in each cell of `cell` metres; `across` in metres."""
        size = cell * self.recipe.scale
        found = scratches(self.place.detach() / size, self.normal.detach(), share.detach(), self._seed(stream))
        return Scratches(found.across * size, found.along, found.weight, found.random)

    def steep(self) -> Values:
        """1 on flanks, 0 on roofs and floors."""
        return 1.0 - ramp(0.45, 0.9, self.normal[:, 1].abs())

    def _cells(
        self, size: float, stretch: tuple[float, float, float], warp: Colors | None = None
    ) -> Float[Tensor, "texels 3"]:
        place = self.place if warp is None else self.place + warp
        cells = 1.0 / (size * self.recipe.scale)
        return place * constant((cells / stretch[0], cells / stretch[1], cells / stretch[2]), place.device)

    def _seed(self, stream: int) -> int:
        return self.recipe.seed * 64 + stream


@lru_cache(maxsize=512)
def constant(numbers: tuple[float, ...], device: torch.device) -> Tensor:
    """A float32 tensor that is copied to a GPU once: each copy waits for what the GPU still has to do."""
    return torch.tensor(numbers, device=device)


def ramp(start: float, end: float, value: Values) -> Values:
    """Smoothstep from 0 at `start` to 1 at `end`; `start` may be greater than `end`."""
    t = ((value - start) / (end - start)).clamp(0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def _ramp_number(start: float, end: float, value: float) -> float:
    t = min(max((value - start) / (end - start), 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)


def film(depth: Values) -> Values:
    """Alpha of a film of matter by its optical depth, at least 0."""
    return 1.0 - torch.exp(-depth)


def mix(first: Color, second: Color, share: Values) -> Colors:
    """Linear mixture of two colours; `share` is that of the second."""
    a, b = (constant(color, share.device) if isinstance(color, tuple) else color for color in (first, second))
    return torch.lerp(a.expand(len(share), 3), b.expand(len(share), 3), share[:, None])


def over(top: Values, below: Values) -> Values:
    """Alpha of one coat over another."""
    return top + below * (1.0 - top)


def blend(below: Color, alpha: Values, top: Color, top_alpha: Values) -> Colors:
    """Colour of one coat over another, of straight alpha."""
    whole = over(top_alpha, alpha)
    return mix(below, top, top_alpha / whole.clamp(min=1e-6))
