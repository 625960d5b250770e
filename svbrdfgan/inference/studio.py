"""Pictures of a weathered surface for people: in a studio's light, on a floor without a horizon."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.errors import AssetError
from svbrdfgan.inference.denoising import can_denoise, denoised
from svbrdfgan.inference.ground import Cove, floor_alone, on_floor, with_floor
from svbrdfgan.inference.tone_mapping import neutral_tone
from svbrdfgan.io.image import save_image
from svbrdfgan.rendering.checked_renderer import CheckedRenderer, PreparedSurface
from svbrdfgan.rendering.compositing import over
from svbrdfgan.scene.subject import Subject
from svbrdfgan.types import Camera, Layer, Materials, Rendering, Surface, View
from svbrdfgan.utils.display import Display, SilentDisplay

BOUNCES = 3
"""Scattering events that a renderer of pictures should follow: the floor is seen in paint, and lights what is low."""
_PICTURE = (1600, 900)
_FOV = math.radians(20.0)
_AZIMUTH, _ELEVATION = 35.0, 11.0
"""Degrees: the front three-quarter view, from a little above."""
_MARGIN = 1.22
_SPP = (96, 32)
"""Samples per pixel without and with a denoiser."""
_PASS = 12_000_000
"""Samples that are taken at once."""


@dataclass(frozen=True, eq=False)
class Studio:
    """A renderer in a light, for pictures of surfaces with their nose at +Z.

    Attributes:
        environment: linear radiance, equirectangular, of which the light from above counts; its scale does not matter.

    Raises:
        AssetError: the light from above is black.
    """

    renderer: CheckedRenderer
    environment: Float[Tensor, "rows cols 3"]

    def __post_init__(self) -> None:
        if float(self.environment[: (len(self.environment) + 1) // 2].mean()) <= 0:
            raise AssetError("the environment is black above the horizon, so nothing would be visible; choose another.")

    @cached_property
    def cove(self) -> Cove:
        """The light and the floor."""
        return Cove.of(self.environment, _orbit(1.0, (0.0, 0.0, 0.0)).origin)

    def stand(self, surface: Surface) -> Stand:
        """The surface in this light, to be shown in any materials."""
        return Stand(self, surface)


@dataclass(frozen=True, eq=False)
class Stand:
    """A surface in a studio."""

    studio: Studio
    surface: Surface
    _grounds: dict[tuple[int, int, int], Tensor] = field(default_factory=dict, repr=False)

    def sharing_shadow(self, surface: Surface) -> Stand:
        """A stand of a surface of the same shape, such as other UVs make, on whose floor the same shadow lies.

        A renderer of direct light alone then renders the floor once.
        """
        return replace(self, surface=surface)

    def show(
        self,
        materials: Materials,
        *,
        size: tuple[int, int] | None = None,
        spp: int | None = None,
        progress: Callable[[int], None] | None = None,
    ) -> Float[Tensor, "height width 3"]:
        """The surface from its front and one side; linear display values in [0, 1], on the CPU.

        Args:
            size: width and height, pixels; by default 1600 x 900.
            spp: by default as many as look clean, which depends on whether a denoiser is installed.
            progress: called with the number of samples of each pixel that were taken since the last call.

        Raises:
            UnsupportedError: the renderer does not read one of the maps.
        """
        size = size or _PICTURE
        view = View(_camera(self.surface, size), self.studio.cove.light, *size)
        image = self._render(materials, view, spp or _SPP[can_denoise()], progress)
        if can_denoise():
            image = denoised(image, self._standing, with_floor(materials), view.camera)
        return neutral_tone(image).cpu()

    def write(
        self, path: Path, materials: Materials, *, spp: int | None = None, display: Display | None = None
    ) -> None:
        """Writes the picture; .png or .jpg. The display counts samples of each pixel.

        Raises:
            AssetError: the file cannot be written.
        """
        shown, spp = display or SilentDisplay(), spp or _SPP[can_denoise()]
        renders = 1 if self.studio.renderer.capabilities.max_bounces > 1 else 2
        shown.stage(f"rendering {path}", renders * spp)
        save_image(path, self.show(materials, spp=spp, progress=shown.advance))

    def _render(
        self, materials: Materials, view: View, spp: int, progress: Callable[[int], None] | None
    ) -> Float[Tensor, "height width 3"]:
        """The linear picture before the background.

        A renderer of direct light alone would show no floor in paint, and nothing below. So it renders the object in
        the light that the floor would reflect, and then adds the floor with the object's shadow.
        """
        renderer, floor = self.studio.renderer, self.studio.cove.floor.to(self.studio.renderer.device)
        if renderer.capabilities.max_bounces > 1:
            whole = _in_passes(renderer, self._prepared, with_floor(materials), view, spp, progress)
            return over(whole.image, whole.coverage, floor)
        key = (view.width, view.height, spp)
        if key not in self._grounds:
            ground = _in_passes(renderer, self._prepared, floor_alone(materials), view, spp, progress)
            self._grounds[key] = over(ground.image, ground.coverage, floor)
        return _in_passes(renderer, self._alone, materials, view, spp, progress).image + self._grounds[key]

    @cached_property
    def _standing(self) -> Surface:
        return on_floor(self.surface)

    @cached_property
    def _prepared(self) -> PreparedSurface:
        return self.studio.renderer.prepare(self._standing)

    @cached_property
    def _alone(self) -> PreparedSurface:
        return self.studio.renderer.prepare(self.surface)


def _in_passes(
    renderer: CheckedRenderer,
    prepared: PreparedSurface,
    materials: Materials,
    view: View,
    spp: int,
    progress: Callable[[int], None] | None,
) -> Rendering:
    """The picture as the mean of passes, so that one sees how far it is; a small one has a single pass."""
    most = max(1, _PASS // (view.width * view.height))
    image, coverage = torch.zeros(()), torch.zeros(())
    for first in range(0, spp, most):
        count = min(most, spp - first)
        made = renderer.render(prepared, materials, view, spp=count, seed=first)
        image, coverage = image + made.image * (count / spp), coverage + made.coverage * (count / spp)
        if progress is not None:
            progress(count)
    return Rendering(image, coverage)


def write_picture(
    path: Path,
    subject: Subject,
    layer: Layer,
    renderer: CheckedRenderer,
    environment: Float[Tensor, "rows cols 3"],
    maps: Mapping[str, float | None] | None = None,
    *,
    spp: int | None = None,
) -> None:
    """Renders the weathered surface from its front and one side, on a floor without a horizon.

    Args:
        path: .png or .jpg.
        environment: linear radiance, equirectangular, of which the light from above counts; its scale does not matter.
        maps: as for `Subject.materials`.
        spp: as for `Stand.show`.

    Raises:
        AssetError: the layer paints other maps, the light is black, or the file cannot be written.
        UnsupportedError: the renderer does not read one of the maps.
    """
    Studio(renderer, environment).stand(subject.surface).write(path, subject.materials(layer, maps), spp=spp)


def _camera(surface: Surface, size: tuple[int, int]) -> Camera:
    """The camera that shows the surface centred and as large as the picture allows, but for a margin."""
    points, tangent, (width, height) = surface.positions, math.tan(_FOV / 2), size
    axes = _orbit(1.0, (0.0, 0.0, 0.0)).basis()
    target, distance = (points.min(axis=0) + points.max(axis=0)) / 2, 1.0
    for _ in range(4):  # perspective moves the centre when the distance changes; this converges fast
        right, top, nearer = axes @ (points - target).T
        distance = float(np.max(np.maximum(abs(right) * height / width, abs(top)) / tangent + nearer))
        seen = np.stack([right, top]) / (_MARGIN * distance - nearer)
        target = target + distance * (seen.min(axis=1) + seen.max(axis=1)) / 2 @ axes[:2]
    x, y, z = target.tolist()
    return _orbit(_MARGIN * distance, (x, y, z))


def _orbit(distance: float, target: tuple[float, float, float]) -> Camera:
    return Camera.orbit(math.radians(_AZIMUTH), math.radians(_ELEVATION), distance, target, _FOV)
