"""Writes a weathered mesh as GLB and PNG, which common viewers show."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import normalize

from svbrdfgan.errors import AssetError
from svbrdfgan.geometry.tangents import corner_tangents
from svbrdfgan.io.gltf.surface_files import save_glb
from svbrdfgan.io.image import save_image, save_texture
from svbrdfgan.rendering.checked_renderer import CheckedRenderer
from svbrdfgan.rendering.compositing import over
from svbrdfgan.scene.subject import Subject
from svbrdfgan.types import Camera, Environment, Layer, Materials, Rendering, View

_PICTURE = (480, 300)
_FOV = math.radians(22.0)
_FROM = ((35.0, 12.0), (215.0, 12.0))
"""Azimuth and elevation in degrees: the nose and one side, then the tail and the other."""
_MARGIN = 1.08
_BRIGHTNESS = 0.8  # mean radiance of the light
_GREY = 0.35  # linear, of the background
_QUANTILE = 0.98
_BRIGHTEST = 0.9
"""Exposure puts the 98th percentile at 0.9 at most, so that pale paint does not become white."""


def write_weathered(
    path: Path,
    subject: Subject,
    layer: Layer,
    maps: Mapping[str, float | None] | None = None,
) -> Path:
    """Writes the surface as GLB, with the layer composited over its learnable parts, and the layer as PNG next to it.

    The maps are in the GLB too, with tangents where there are normals; other parts keep those of the mesh's file, and
    its alpha. Each map also becomes a PNG, such as `NAME.roughness.png`, whose numbers are the map's own and not sRGB:
    `NAME.normal.png` holds 0.5 + 0.5 (x, y, z), +y upwards.

    Args:
        maps: as for `Subject.materials`.

    Returns:
        The path of the layer's PNG, which holds its RGBA.

    Raises:
        AssetError: the layer paints other maps, or a file cannot be written.
    """
    materials = subject.materials(layer, maps)
    colors = {part: material.base_color for part, material in enumerate(materials.parts)}
    textures = {part: color for part, color in colors.items() if color.ndim == 3}
    further = _further_maps(subject, materials)
    tangents = None
    if any("normal" in named for named in further.values()):
        tangents = corner_tangents(subject.surface).attribute()
    save_glb(path, subject.surface, textures, further, tangents)
    for name in layer.maps:
        values = further[subject.learnable[0]][name]
        numbers = 0.5 + 0.5 * values if name == "normal" else values
        save_texture(path.with_suffix(f".{name}.png"), numbers, "raw")
    layer_path = path.with_suffix(".layer.png")
    save_texture(layer_path, layer.rgba)
    return layer_path


@dataclass(frozen=True, eq=False)
class Studio:
    """A surface in a light, to be shown under any layer.

    Attributes:
        environment: linear radiance, equirectangular; scaled to a fixed mean.
        maps: as for `Subject.materials`.

    Raises:
        AssetError: the light is black.
    """

    subject: Subject
    renderer: CheckedRenderer
    environment: Float[Tensor, "rows cols 3"]
    maps: Mapping[str, float | None] | None = None

    def __post_init__(self) -> None:
        if float(self.environment.mean()) <= 0:
            raise AssetError("the environment is black, so that nothing would be visible; choose another.")

    @cached_property
    def _prepared(self) -> Any:
        return self.renderer.prepare(self.subject.surface)

    def show(self, layer: Layer, *, spp: int = 64, sides: int = 2) -> Rendering:
        """The weathered surface from the front and, by default, from behind, side by side; linear.

        Raises:
            AssetError: the layer paints other maps.
            UnsupportedError: the renderer does not read one of the maps.
        """
        light = Environment(self.environment * (_BRIGHTNESS / float(self.environment.mean())))
        materials = self.subject.materials(layer, self.maps)
        views = [View(_camera(self.subject, *angles), light, *_PICTURE) for angles in _FROM[:sides]]
        shown = [self.renderer.render(self._prepared, materials, view, spp=spp, seed=0) for view in views]
        image = torch.cat([side.image for side in shown], dim=1)
        return Rendering(image, torch.cat([side.coverage for side in shown], dim=1))

    def write(self, path: Path, layer: Layer, *, spp: int = 64) -> None:
        """Writes the picture of both sides; see `write_picture`."""
        (picture,) = developed([self.show(layer, spp=spp)])
        save_image(path, picture)


def developed(shown: Sequence[Rendering]) -> list[Float[Tensor, "height width 3"]]:
    """The pictures on grey, all with the exposure that none of them becomes white with; linear, on the CPU."""
    covered = torch.cat([picture.image[picture.coverage > 0].amax(dim=-1) for picture in shown])
    # every n-th pixel, since torch's quantile takes 16 million values at most
    brightest = torch.quantile(covered[:: 1 + len(covered) // 10_000_000], _QUANTILE)
    exposure, grey = (_BRIGHTEST / brightest).clamp(max=1), torch.full((3,), _GREY, device=covered.device)
    return [over(picture.image * exposure, picture.coverage, grey).cpu() for picture in shown]


def write_picture(
    path: Path,
    subject: Subject,
    layer: Layer,
    renderer: CheckedRenderer,
    environment: Float[Tensor, "rows cols 3"],
    maps: Mapping[str, float | None] | None = None,
    *,
    spp: int = 64,
) -> None:
    """Renders the weathered surface from the front and from behind, side by side on grey.

    Args:
        path: .png or .jpg.
        environment: linear radiance, equirectangular; scaled to a fixed mean.
        maps: as for `Subject.materials`.

    Raises:
        AssetError: the layer paints other maps, the light is black, or the file cannot be
            written.
        UnsupportedError: the renderer does not read one of the maps.
    """
    Studio(subject, renderer, environment, maps).write(path, layer, spp=spp)


def _camera(subject: Subject, azimuth: float, elevation: float) -> Camera:
    """The camera at these angles (degrees) that shows the surface centred and as large as the picture allows."""
    points = subject.surface.positions
    angles, tangent, (width, height) = (math.radians(azimuth), math.radians(elevation)), math.tan(_FOV / 2), _PICTURE
    axes = Camera.orbit(*angles, 1.0, (0.0, 0.0, 0.0), _FOV).basis()
    target, distance = (points.min(axis=0) + points.max(axis=0)) / 2, 1.0
    for _ in range(4):  # perspective moves the centre when the distance changes; this converges fast
        right, top, nearer = axes @ (points - target).T
        distance = float(np.max(np.maximum(abs(right) * height / width, abs(top)) / tangent + nearer))
        seen = np.stack([right, top]) / (_MARGIN * distance - nearer)
        target = target + distance * (seen.min(axis=1) + seen.max(axis=1)) / 2 @ axes[:2]
    x, y, z = target.tolist()
    return Camera.orbit(*angles, _MARGIN * distance, (x, y, z), _FOV)


def _further_maps(subject: Subject, materials: Materials) -> dict[int, dict[str, Float[Tensor, "*shape"]]]:
    """Roughness, metallic and unit normals by part. Learnable parts that have the same share their tensors."""
    further: dict[int, dict[str, Float[Tensor, "*shape"]]] = {}
    for part, material in enumerate(materials.parts):
        same = (k for k in subject.learnable if part in subject.learnable and k < part)
        if (first := next((k for k in same if _equal(materials[k].maps, material.maps)), None)) is not None:
            further[part] = further[first]
            continue
        further[part] = {name: values for name, values in material.maps.items() if name != "base_color"}
        if "normal" in further[part]:
            further[part]["normal"] = normalize(further[part]["normal"], dim=-1)
    return further


def _equal(one: Mapping[str, Tensor], other: Mapping[str, Tensor]) -> bool:
    """Whether both materials have the same maps apart from base_color."""
    names = one.keys() - {"base_color"}
    return names == other.keys() - {"base_color"} and all(torch.equal(one[name], other[name]) for name in names)
