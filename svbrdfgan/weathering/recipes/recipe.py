"""What a weathering recipe is: options, and a coat of all material maps at each texel of a site."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, ClassVar, Protocol

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.weathering.ranges import check_ranges, number
from svbrdfgan.weathering.site import Site
from svbrdfgan.weathering.substances import Substance

Values = Float[Tensor, " texels"]
Colors = Float[Tensor, "texels 3"]
Directions = Float[Tensor, "texels 3"]


@dataclass(frozen=True, eq=False)
class Coat:
    """The maps that a recipe paints, at each texel.

    Attributes:
        color: linear RGB in [0, 1].
        alpha: straight alpha in [0, 1], for all maps.
        roughness, metallic: in [0, 1].
        height: of the coat's relief, in lengths of the model; its slope becomes the normal map.
    """

    color: Colors
    alpha: Values
    roughness: Values
    metallic: Values
    height: Values

    @classmethod
    def joined(cls, coats: Iterable[Coat]) -> Coat:
        """One coat of the parts of a site."""
        parts = zip(*(vars(coat).values() for coat in coats), strict=True)
        return cls(*(torch.cat(values) for values in parts))

    @property
    def rgba(self) -> Float[Tensor, "texels 4"]:
        return torch.cat([self.color, self.alpha[:, None]], dim=1)


class Recipe(Protocol):
    """A frozen record of options, with methods that paint a site."""

    settles_on: ClassVar[Mapping[Substance, float]]
    """How thickly it lies on each substance, or how readily it eats it; substances that are not named stay as they are.
    If it is empty, the recipe does not go by substances, and lies on all that weathers."""
    metal: ClassVar[bool]
    """Whether its matter, or what lies bare under it, is metal anywhere; else metallic is 0 wherever it lies."""
    reads_edges: ClassVar[bool]
    """Whether it goes by the site's distances to edges."""

    @property
    def amount(self) -> float: ...

    @property
    def seed(self) -> int: ...

    @property
    def relief(self) -> float: ...

    def paint(self, site: Site) -> Coat:
        """All maps: a pure function of the site, texel by texel. `amount` 0 gives alpha 0."""

    def paint_relief(self, site: Site, *axes: Directions) -> tuple[Coat, list[Values]]:
        """All maps, and for each axis how the height grows along it: slopes, without unit."""


@dataclass(frozen=True)
class Options:
    """The options that every recipe has; a recipe's docstring says what its amounts look like.

    Attributes:
        amount: how much of the matter there is.
        seed: selects another pattern of the same kind.
        scale: size of the pattern, relative to the default.
        relief: height of the relief, relative to the default, which is as high as the matter is thick.

    Raises:
        ConfigError: an option out of its range.
    """

    settles_on: ClassVar[Mapping[Substance, float]] = MappingProxyType({Substance.PAINT: 1.0})
    metal: ClassVar[bool] = False
    reads_edges: ClassVar[bool] = False

    amount: float = number(0.6, 0.0, 1.0)
    seed: int = number(0, 0, 2**31 - 1)
    scale: float = number(1.0, 0.25, 4.0)
    relief: float = number(1.0, 0.0, 50.0)

    def __post_init__(self) -> None:
        check_ranges(self)

    def paint(self, site: Site) -> Coat:
        """All maps; see `Recipe.paint`."""
        raise NotImplementedError

    def paint_relief(self, site: Site, *axes: Directions) -> tuple[Coat, list[Values]]:
        """All maps and slopes, by automatic differentiation; see `Recipe.paint_relief`."""
        position = site.position.detach().requires_grad_()
        with torch.enable_grad():
            coat = self.paint(replace(site, position=position))
            (gradient,) = torch.autograd.grad(coat.height.sum(), position)
        return _detached(coat), [(gradient * axis).sum(dim=1) for axis in axes]


def _detached(coat: Coat) -> Coat:
    values: dict[str, Any] = {name: value.detach() for name, value in vars(coat).items()}
    return Coat(**values)
