"""The lights in which a viewer shows models: a studio, skies, and maps of the user's own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import interpolate

from svbrdfgan.inference.ground import Cove
from svbrdfgan.procedural.sky import build_sky, sample_sky
from svbrdfgan.procedural.softboxes import build_studio

ROWS, COLS = 128, 256
"""Of the map that a page gets."""

_SKIES = {"Clear sky": 4, "Clouds": 1}
"""Seeds of procedural skies that look like this."""
_TOWARD = (0.0, 0.0, 1.0)


@dataclass(frozen=True, eq=False)
class Light:
    """A light above a floor without a horizon.

    Attributes:
        values: linear radiance, equirectangular, exposed for white paint.
        floor: linear radiance of the unshadowed floor.
    """

    name: str
    values: Float[Tensor, "rows cols 3"]
    floor: tuple[float, float, float]

    @classmethod
    def of(cls, name: str, radiance: Float[Tensor, "rows cols 3"]) -> Light:
        """The light from above in a map of radiance, which must not be black there."""
        cove = Cove.of(_resized(radiance), _TOWARD)
        r, g, b = cove.floor.tolist()
        return cls(name, cove.light.radiance, (r, g, b))

    def half_floats(self) -> bytes:
        """The map as 16-bit RGBA, little-endian: the bottom row first, the first column at direction -X, as three.js
        looks environments up."""
        values = np.roll(self.values.numpy()[::-1], -COLS // 4, axis=1).clip(0.0, 6e4)
        opaque = np.concatenate([values, np.ones_like(values[..., :1])], axis=-1)
        return opaque.astype("<f2").tobytes()


def usual_lights() -> list[Light]:
    """A studio's soft boxes, and skies."""
    skies = {name: build_sky(sample_sky(seed), ROWS, COLS) for name, seed in _SKIES.items()}
    return [Light.of(name, values) for name, values in {"Studio": build_studio(), **skies}.items()]


def _resized(radiance: Float[Tensor, "rows cols 3"]) -> Float[Tensor, "rows cols 3"]:
    """At the page's size; averaged where it becomes smaller, so that no lamp is lost."""
    whole = radiance.float().cpu().permute(2, 0, 1)[None]
    mode = "area" if whole.shape[2] >= ROWS else "bilinear"
    return interpolate(whole, (ROWS, COLS), mode=mode)[0].permute(1, 2, 0)
