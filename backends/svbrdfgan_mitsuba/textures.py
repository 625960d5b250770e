"""Textures as flat lists of texels, bilinear lookups, and the accumulation of gradients at the texels.

One list holds a map of all parts, so that one kernel serves every surface.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.types import Environment, Gradients, Material, Materials
from svbrdfgan_mitsuba.interop import dr, floats, tensor, unsigned

NEUTRAL = {"base_color": (1.0, 1.0, 1.0), "roughness": (1.0,), "metallic": (0.0,), "normal": (0.0, 0.0, 1.0)}
"""The maps that are read, and what is read where another part has the map."""


@dataclass(frozen=True, eq=False)
class Taps:
    """The four texels that each point reads, and their weights: a linear map, and its transpose.

    Attributes:
        index: of the texels.
        weight: of each of them.
        active: inactive points read zero.
    """

    index: tuple[Any, ...]
    weight: tuple[Any, ...]
    active: Any

    def read(self, kind: type[Any], texels: Any) -> Any:
        """The weighted sum at each point, of type `kind`, with as many components as a texel has."""
        values = [dr.gather(kind, texels, i, self.active) * w for i, w in zip(self.index, self.weight, strict=True)]
        return (values[0] + values[1]) + (values[2] + values[3])

    def scatter(self, sums: Any, values: Sequence[Any]) -> None:
        """Adds values at the points, one array per channel, to the float64 sums at their texels: the transpose."""
        number, mode = type(sums), dr.ReduceMode.Local  # other modes compile the length of `sums` into the kernel
        add = dr.ReduceOp.Add
        for index, weight in zip(self.index, self.weight, strict=True):
            for channel, value in enumerate(values):
                place = index * len(values) + channel
                dr.scatter_reduce(add, sums, number(weight * value), place, self.active, mode)


def bilinear_taps(uv: Any, first: Any, cols: Any, rows: Any, repeat: tuple[Any, Any], active: Any) -> Taps:
    """The lookup at `uv` in an image of rows x cols texels that begins at texel `first`.

    Texel (row, col) is centred at u = (col + 0.5) / cols, v = (row + 0.5) / rows. Beyond the border the image is
    clamped, or repeated along the axes (u, v) that `repeat` selects.
    """
    left, right, x = _neighbours(uv.x, cols, repeat[0])
    lower, upper, y = _neighbours(uv.y, rows, repeat[1])
    below, above = dr.fma(lower, cols, first), dr.fma(upper, cols, first)
    index = (below + left, below + right, above + left, above + right)
    return Taps(index, ((1 - y) * (1 - x), (1 - y) * x, y * (1 - x), y * x), active)


@dataclass(frozen=True, eq=False)
class Atlas:
    """The texels of one map of every part, part by part and row by row; a constant is one texel.

    Attributes:
        texels: their values, the channels of each together.
        layout: four numbers per part: its first texel, its columns, its rows, and whether it has the map.
        repeat: whether to repeat along u and along v, instead of clamping.
        shapes: of the parts' maps; None for a part without it.
    """

    texels: Any
    layout: Any
    repeat: tuple[Any, Any]
    shapes: tuple[torch.Size | None, ...]
    channels: int

    @classmethod
    def of(
        cls,
        mi: Any,
        maps: Sequence[Float[Tensor, "*shape"] | None],
        missing: Float[Tensor, " channels"],
        repeat: tuple[bool, bool],
        device: torch.device,
    ) -> Atlas:
        """The atlas of the parts' maps, with the value `missing` for a part without one."""
        values = [missing if value is None else value for value in maps]
        layout, first = [], 0
        for value, given in zip(values, maps, strict=True):
            rows, cols = value.shape[:-1] or (1, 1)
            layout.append((first, cols, rows, int(given is not None)))
            first += rows * cols
        pieces = [value.detach().to(device, torch.float32).reshape(-1) for value in values]
        return cls(
            texels=floats(mi, torch.cat(pieces) if len(pieces) > 1 else pieces[0], device),
            layout=unsigned(mi, torch.tensor(layout), device),
            repeat=(dr.opaque(mi.Bool, repeat[0]), dr.opaque(mi.Bool, repeat[1])),
            shapes=tuple(None if value is None else value.shape for value in maps),
            channels=len(missing),
        )

    def taps(self, mi: Any, part: Any, uv: Any, active: Any) -> tuple[Taps, Any]:
        """The lookup at each point of a part, and whether the part has the map."""
        place = dr.gather(mi.Vector4u, self.layout, part, active)
        return bilinear_taps(uv, place.x, place.y, place.z, self.repeat, active), place.w != 0

    def zeros(self, mi: Any) -> Any:
        """Sums for `Taps.scatter`."""
        return dr.zeros(mi.Float64, dr.width(self.texels))

    def split(self, sums: Any) -> list[Tensor | None]:
        """The sums of each part, float32 and shaped like its map; None for a part without it."""
        sizes = [self.channels if shape is None else shape.numel() for shape in self.shapes]
        pieces = tensor(type(self.texels)(sums)).split(sizes)
        return [
            None if shape is None else piece.reshape(shape) for piece, shape in zip(pieces, self.shapes, strict=True)
        ]


@dataclass(frozen=True, eq=False)
class Lookup:
    """The values that many points read in one map.

    Attributes:
        given: whether the point's part has the map.
        value: a colour, a vector or a number at each point.
    """

    taps: Taps
    given: Any
    value: Any


@dataclass(frozen=True, eq=False)
class MaterialMaps:
    """The maps of all parts, by name: the base colour, and those that some part has.

    Other maps are not in the kernels, so that scenes without them cost nothing for them.
    """

    atlases: Mapping[str, Atlas]

    @classmethod
    def of(cls, mi: Any, materials: Materials, repeat: tuple[bool, bool], device: torch.device) -> MaterialMaps:
        """The maps of these materials."""
        atlases = {}
        for name, neutral in NEUTRAL.items():
            given = [material.maps.get(name) for material in materials.parts]
            if any(value is not None for value in given):
                atlases[name] = Atlas.of(mi, given, torch.tensor(neutral, device=device), repeat, device)
        return cls(atlases)

    @property
    def base_color(self) -> Atlas:
        return self.atlases["base_color"]

    def lookups(self, mi: Any, part: Any, uv: Any, active: Any) -> Mapping[str, Lookup]:
        """The lookup of each map at each point of a part."""
        found = {}
        for name, atlas in self.atlases.items():
            taps, given = atlas.taps(mi, part, uv, active)
            found[name] = Lookup(taps, given, taps.read(_kind(mi, name), atlas.texels))
        return found


@dataclass(frozen=True, eq=False)
class GradientAccumulator:
    """Sums of gradients, float64, for each number of the inputs that are differentiated; None for the others.

    In float32 the sum for a constant map would stop growing after 2^24 equal additions.

    Attributes:
        maps: by the name of the map; only of those that are differentiated.
        environment: None if it is not differentiated.
    """

    mi: Any
    maps: Mapping[str, Any]
    environment: Any | None

    @classmethod
    def of(cls, mi: Any, maps: MaterialMaps, environment: Environment, wrt: Set[str]) -> GradientAccumulator:
        """Sums of zero."""
        return cls(
            mi,
            {name: atlas.zeros(mi) for name, atlas in maps.atlases.items() if name in wrt},
            dr.zeros(mi.Float64, environment.radiance.numel()) if "environment" in wrt else None,
        )

    def gradients(self, maps: MaterialMaps, environment: torch.Size) -> Gradients:
        """The sums, shaped like the maps and the environment's image."""
        parts: list[dict[str, Tensor]] = [{} for _ in maps.base_color.shapes]
        for name, sums in self.maps.items():
            for part, gradient in enumerate(maps.atlases[name].split(sums)):
                if gradient is not None:
                    parts[part][name] = gradient
        light = None if self.environment is None else tensor(self.mi.Float(self.environment)).view(environment)
        return Gradients(tuple(parts), light)


def snapshot(materials: Materials) -> Materials:
    """Materials that do not change when the caller writes into these.

    Only those of a single part are copied: `Atlas` shares the memory of one map, and concatenates several.
    """
    if len(materials) > 1:
        return materials
    return Materials(tuple(Material({n: m.detach().clone() for n, m in part.maps.items()}) for part in materials.parts))


def _kind(mi: Any, name: str) -> type[Any]:
    kinds: dict[str, type[Any]] = {"base_color": mi.Color3f, "normal": mi.Vector3f}
    return kinds.get(name, mi.Float)


def _neighbours(coordinate: Any, size: Any, repeat: Any) -> tuple[Any, Any, Any]:
    """The texels before and after along one axis, and the weight of the latter."""
    whole = type(size)
    signed = dr.int32_array_t(whole)
    position = dr.fma(coordinate, size, -0.5)
    floor = dr.floor(position)
    before, last = signed(floor), signed(size) - 1
    after = before + 1
    # Half a texel further: exact quotients are whole numbers, below which rounding could fall.
    periods = signed(size) * signed(dr.floor((floor + 0.5) / size))
    around = before - periods
    beyond = dr.select(around == last, 0, around + 1)
    before = dr.select(repeat, around, dr.clip(before, 0, last))
    after = dr.select(repeat, beyond, dr.clip(after, 0, last))
    return whole(before), whole(after), position - floor
