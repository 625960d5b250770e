"""One draw of a generator: a function of geometry alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from svbrdfgan.networks.generator import Generator
from svbrdfgan.networks.inputs import Inputs
from svbrdfgan.networks.tiles import Windows, paint_in_tiles

_FAINT = 0.05


@dataclass(frozen=True, eq=False)
class Draw:
    """A generator whose seed and labels are fixed.

    Attributes:
        seed: of the random fields, if the generator has any; at least 0.
        labels: what is wanted of the layer, as many numbers as the generator reads.
        opacity: what its alpha is multiplied by; see `opacity_of`.
        windows: what the generator was trained on, if that were windows and it is to paint whole maps.
    """

    generator: Generator
    seed: int = 0
    labels: Sequence[float] = ()
    opacity: float = 1.0
    windows: Windows | None = None

    def __call__(
        self,
        geometry: Float[Tensor, "batch inputs rows cols"],
        factor: int = 1,
        wanted: Bool[Tensor, "rows cols"] | None = None,
    ) -> Float[Tensor, "batch fine_rows fine_cols channels"]:
        """The layer of this seed and these labels on each geometry, `factor` times as fine as it.

        The generator's device computes it in float32, without the shorter products of GPUs (TF32), so that all devices
        paint the same but for rounding. The layer is returned on the geometry's device.

        Args:
            wanted: texels where the layer is needed, which may save time.
        """
        device = next(self.generator.parameters()).device
        read, asked = geometry.to(device), self._asked(len(geometry), device)
        with torch.backends.cudnn.flags(enabled=True, allow_tf32=False):
            if self.windows is None:
                layers = self.generator(read, *asked, factor)
            else:
                finer = factor // self.windows.finer
                layers = paint_in_tiles(self.generator, self.windows, read, *asked, finer, wanted)
        return self._faded(layers).to(geometry.device)

    def on(self, inputs: Inputs) -> Float[Tensor, "batch rows cols channels"]:
        """The layer of this seed and these labels on each surface of a batch, as training sees them."""
        return self._faded(self.generator.paint(inputs, *self._asked(len(inputs), inputs.device)))

    def _asked(self, count: int, device: torch.device) -> tuple[Tensor, Tensor]:
        seeds = torch.full((count,), self.seed, dtype=torch.int64, device=device)
        return seeds, torch.tensor([list(self.labels)] * count, dtype=torch.float32, device=device)

    def _faded(self, layers: Tensor) -> Tensor:
        if self.opacity < 1.0:
            layers[..., self.generator.channels["alpha"]] *= self.opacity
        return layers


def opacity_of(amount: float) -> float:
    """What the alpha of a layer of this amount is multiplied by: 1 from 0.05 on, and 0 at 0, which is clean.

    A generator still paints a little at 0, which few exemplars show.
    """
    return min(1.0, amount / _FAINT)
