"""What generators read: geometry, and of windows the whole that they are cut from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int
from torch import Tensor

from svbrdfgan.utils.copy_async import copy_async


@dataclass(frozen=True, eq=False)
class Wholes:
    """Whole maps, and where windows lie in them.

    Attributes:
        geometry: of each whole map, as generators read it.
        of: the whole map of each window, by its index.
        place: of each window: its first row and column, and its rows and columns, over those of the whole map.
    """

    geometry: Float[Tensor, "wholes inputs rows cols"]
    of: Int[Tensor, " batch"]
    place: Float[Tensor, "batch 4"]


@dataclass(frozen=True, eq=False)
class Inputs:
    """What a generator reads of a batch of surfaces.

    Attributes:
        geometry: position and normal (`GeometryBuffer.network_input`), then mesh maps if it reads them.
        wholes: of windows, for a generator that refines layers of whole maps; else None.
    """

    geometry: Float[Tensor, "batch inputs rows cols"]
    wholes: Wholes | None = None

    def __len__(self) -> int:
        return len(self.geometry)

    @property
    def device(self) -> torch.device:
        return self.geometry.device

    @property
    def nbytes(self) -> int:
        """Bytes without whole maps, which many may share."""
        return self.geometry.nbytes

    @classmethod
    def joined(cls, parts: Sequence[Inputs]) -> Inputs:
        """One batch of all. Whole maps that are one tensor stay one."""
        geometry = torch.cat([part.geometry for part in parts])
        wholes = [part.wholes for part in parts if part.wholes is not None]
        if not wholes:
            return cls(geometry)
        first: dict[int, int] = {}  # index of the first map of each tensor among those of the result
        kept: list[Tensor] = []
        for each in wholes:
            if id(each.geometry) not in first:
                first[id(each.geometry)] = sum(len(maps) for maps in kept)
                kept.append(each.geometry)
        of = torch.cat([each.of + first[id(each.geometry)] for each in wholes])
        return cls(geometry, Wholes(torch.cat(kept), of, torch.cat([each.place for each in wholes])))

    def pick(self, indices: Int[Tensor, " batch"] | slice) -> Inputs:
        """Those of some surfaces of the batch."""
        wholes = self.wholes
        if isinstance(indices, Tensor):
            indices = copy_async(indices, self.device)
        if wholes is not None:
            wholes = replace(wholes, of=wholes.of[indices], place=wholes.place[indices])
        return Inputs(self.geometry[indices], wholes)

    def to(self, device: torch.device) -> Inputs:
        """The same on a device, images channels last in memory."""
        geometry, wholes = self.geometry.to(device, memory_format=torch.channels_last), self.wholes
        if wholes is not None:
            held = wholes.geometry.to(device, memory_format=torch.channels_last)
            wholes = Wholes(held, wholes.of.to(device), wholes.place.to(device))
        return Inputs(geometry, wholes)


def window_of(
    maps: Float[Tensor, "batch whole_rows whole_cols channels"], place: Float[Tensor, "batch 4"], rows: int, cols: int
) -> Float[Tensor, "batch rows cols channels"]:
    """The maps' values at the texels of windows, between those of the maps by bicubic interpolation.

    Args:
        place: of each window, as in `Wholes`.
        rows, cols: texels of a window.
    """
    first, size = place.float().split(2, dim=1)
    axes = [
        2.0 * (first[:, axis, None] + size[:, axis, None] * _centres(count, place.device)) - 1.0
        for axis, count in enumerate((rows, cols))
    ]
    grid = torch.stack([axes[1][:, None, :].expand(-1, rows, -1), axes[0][:, :, None].expand(-1, -1, cols)], dim=-1)
    with torch.autocast(place.device.type, enabled=False):
        found = F.grid_sample(
            maps.float().permute(0, 3, 1, 2), grid, mode="bicubic", padding_mode="border", align_corners=False
        )
    return found.permute(0, 2, 3, 1)


def _centres(count: int, device: torch.device) -> Float[Tensor, " count"]:
    """Of texels, over the length of all."""
    return (torch.arange(count, device=device) + 0.5) / count
