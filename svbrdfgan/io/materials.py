"""What files say of materials: pictures decoded once for each use, and the parts of OBJ, PLY and STL files."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray
from torch import Tensor

from svbrdfgan.io.image import linear_from_picture, linear_from_srgb, numbers_from_picture
from svbrdfgan.io.uv_sets import UVSet
from svbrdfgan.types import FileMap, Part

if TYPE_CHECKING:
    from PIL.Image import Image

log = logging.getLogger(__name__)

Color = tuple[float, float, float]
WHITE: Color = (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class Pictures:
    """The textures of one file, each decoded once for each of its uses, so that parts with one texture share an array.

    Attributes:
        path: the mesh file, for warnings.
    """

    path: Path
    _known: dict[tuple[int, str], Float[ndarray, "rows cols channels"] | None] = field(default_factory=dict)

    def color(self, image: Image | None) -> Float[ndarray, "rows cols 3"] | None:
        """Linear RGB with row 0 at v = 0. None if there is no image, or, with a warning, if it is broken."""
        return self._decoded(image, "color", lambda picture: linear_from_picture(picture)[..., :3])

    def numbers(self, image: Image | None, channel: int) -> Float[ndarray, "rows cols 1"] | None:
        """The stored numbers of one channel, likewise. None if all are 1, as alpha is in a picture without it."""

        def decode(picture: Image) -> Tensor:
            values = numbers_from_picture(picture)
            if channel >= values.shape[-1]:
                return torch.ones_like(values[..., :1])
            return values[..., channel : channel + 1]

        texture = self._decoded(image, f"channel {channel}", decode)
        return None if texture is None or (texture == 1.0).all() else texture

    def normal(self, image: Image | None) -> Float[ndarray, "rows cols 3"] | None:
        """Normals in tangent space, each of x, y and z in [-1, 1], likewise."""
        return self._decoded(image, "normal", lambda picture: 2.0 * numbers_from_picture(picture)[..., :3] - 1.0)

    def _decoded(
        self, image: Image | None, use: str, decode: Callable[[Image], Tensor]
    ) -> Float[ndarray, "rows cols channels"] | None:
        if image is None:
            return None
        if (id(image), use) not in self._known:
            try:
                self._known[id(image), use] = decode(image).flip(0).numpy()
            except (OSError, SyntaxError, ValueError) as error:
                log.warning("%s has a picture that cannot be read (%s); numbers are used alone", self.path, error)
                self._known[id(image), use] = None
        return self._known[id(image), use]


@dataclass(frozen=True)
class Look:
    """A part, and the further UV sets of its textures: `further[k - 1]` is number k of `Mesh.uv_set`."""

    part: Part
    further: tuple[UVSet, ...] = ()


def read_look(pictures: Pictures, name: str, visual: Any) -> Part:
    """The part for a trimesh visual, named after its material, or else `name`."""
    import trimesh

    if not isinstance(visual, trimesh.visual.TextureVisuals):
        return _colored_part(pictures.path, name, visual)
    material = visual.material
    if not material.kwargs and material.image is not None and material.image.format is None:
        return Part(name)  # trimesh's placeholder material, for a file with UVs but no material
    color = unit_interval(_mtl_color(material))
    return Part(material.name or name, color, pictures.color(material.image), file_maps=_mtl_maps(material))


def _colored_part(path: Path, name: str, visual: Any) -> Part:
    """A part with the mean of the vertex or face colours (sRGB in the file), or the default colour if it has none."""
    if visual.kind not in ("vertex", "face"):
        return Part(name)
    log.info("%s: colours of single vertices or faces are averaged over '%s'", path, name)
    colors = np.asarray(visual.vertex_colors if visual.kind == "vertex" else visual.face_colors)[:, :3] / 255.0
    red, green, blue = linear_from_srgb(torch.from_numpy(colors)).mean(dim=0).tolist()
    return Part(name, (red, green, blue))


def _mtl_color(material: Any) -> Color:
    """Kd, read as linear. With a texture, a missing or black Kd is replaced by white, because exporters write it so."""
    diffuse = material.kwargs.get("kd")
    usable = isinstance(diffuse, list) and len(diffuse) == 3
    if material.image is not None and not (usable and any(diffuse)):
        return WHITE
    return tuple(diffuse) if usable else Part("").base_color


def _mtl_maps(material: Any) -> dict[str, FileMap]:
    """Alpha from `d` or else `Tr`; gloss from `Pr` and `Pm` alone, which are physical.

    `Ks` and `Ns` are Phong's, which is another model, and most exporters write them whether anything shines or not.
    """
    opacity, clarity, rough, metallic = (_mtl_number(material, key) for key in ("d", "tr", "pr", "pm"))
    maps = {}
    alpha = opacity if opacity is not None else None if clarity is None else 1.0 - clarity
    if alpha is not None and alpha < 1.0:
        maps["alpha"] = FileMap((alpha,))
    if rough is not None:
        maps |= {"roughness": FileMap((rough,)), "metallic": FileMap((metallic or 0.0,))}
    return maps


def _mtl_number(material: Any, key: str) -> float | None:
    """A number in [0, 1], the last word of its line (`d -halo 0.5`); None if there is none."""
    try:
        return unit_interval((float(material.kwargs[key][-1]),))[0]
    except (KeyError, IndexError, TypeError, ValueError):
        return None


def unit_interval(values: tuple[float, ...]) -> Any:
    """The values clamped to [0, 1], as a tuple of as many; 0 for what is not a number."""
    return tuple(np.clip(np.nan_to_num(values), 0.0, 1.0).tolist())
