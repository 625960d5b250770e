"""Renders the scenes of pictures: clean, white, in other light; prepares a mesh once for all of its pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.data.photos.light import GLOSS, Render, evidence_size, white
from svbrdfgan.data.photos.pairs import divided
from svbrdfgan.rendering.checked_renderer import CheckedRenderer, PreparedSurface
from svbrdfgan.scene.description import Scene
from svbrdfgan.scene.loader import SceneLoader
from svbrdfgan.types import Environment, Layer, Material, Materials, Rendering, View

Image = Float[Tensor, "height width 3"]

SPP = 64
"""Samples per pixel of clean renderings and of simulated pictures; the noise of as many is measured."""
_SMOOTH_SPP = 1024
"""Samples per pixel of renderings that count as free of noise."""
_LIGHT_SPP = 16
"""Samples per pixel of each lobe of light: estimates are sums over many pixels."""


@dataclass(frozen=True, eq=False)
class Shaded:
    """What a scene's picture is made of: `base * shading + others.image`.

    Attributes:
        shading: the learnable parts, painted white.
        base: their reflectance without weathering; 0 where nothing of them is lit.
        others: all other parts; its coverage is that of the whole mesh.
    """

    shading: Image
    base: Image
    others: Rendering


@dataclass
class PictureRenderer:
    """Renders scenes one after the other, on the renderer's device, with results in main memory.

    Attributes:
        prepared: the last scene's mesh and prepared surface: the next scene usually shows the same mesh.
    """

    loader: SceneLoader
    renderer: CheckedRenderer
    prepared: tuple[str, PreparedSurface] | None = field(default=None, init=False)

    def clean(self, scene: Scene) -> Materials:
        """The materials without weathering."""
        return self.loader.subject(scene).materials(base_colors=scene.materials)

    def weathered(self, scene: Scene, layers: Sequence[Layer]) -> list[Materials]:
        """The materials with each of these layers."""
        subject = self.loader.subject(scene)
        return [subject.materials(layer, base_colors=scene.materials) for layer in layers]

    def gloss(self, scene: Scene) -> Image:
        """The radiance that gloss of the learnable parts adds to the picture, approximately."""
        return GLOSS * self.render(scene, self._white(scene), _SMOOTH_SPP).image

    def shaded(self, scene: Scene, spp: int = _SMOOTH_SPP) -> Shaded:
        """What the scene's picture is made of."""
        clean, learnable = self.clean(scene), self.loader.subject(scene).learnable
        black = Material.lambertian((0.0, 0.0, 0.0))
        dark = Materials(tuple(black if part in learnable else one for part, one in enumerate(clean.parts)))
        shading = self.render(scene, self._white(scene), spp).image
        others, whole = (self.render(scene, materials, spp) for materials in (dark, clean))
        return Shaded(shading, divided(whole.image - others.image, shading), others)

    def noise(self, scene: Scene) -> Image:
        """The relative noise of `SPP` samples per pixel, of mean one, measured on a white mesh."""
        count = len(self.loader.subject(scene).surface.parts)
        noisy, smooth = (self.render(scene, white(range(count), count), spp).image for spp in (SPP, _SMOOTH_SPP))
        return torch.where(smooth > 0, noisy / smooth, 1.0)

    def render(self, scene: Scene, materials: Materials, spp: int = SPP) -> Rendering:
        """The scene with these materials."""
        return self._render(scene, materials, self.loader.view(scene), spp)

    def view(self, scene: Scene, materials: Materials, view: View) -> Image:
        """The scene's mesh in another view."""
        return self._render(scene, materials, view, SPP).image

    def in_light(self, scene: Scene, turn: float) -> Render:
        """Renders the scene in other light, small and quickly; the light is turned by as many radians."""
        width, height = evidence_size(scene.width, scene.height)

        def render(materials: Materials, radiance: Float[Tensor, "rows cols 3"]) -> Rendering:
            view = View(scene.camera.camera(), Environment(radiance, turn), width, height)
            return self._render(scene, materials, view, _LIGHT_SPP)

        return render

    def _white(self, scene: Scene) -> Materials:
        subject = self.loader.subject(scene)
        return white(subject.learnable, len(subject.surface.parts))

    def _render(self, scene: Scene, materials: Materials, view: View, spp: int) -> Rendering:
        if self.prepared is None or self.prepared[0] != scene.mesh.path:
            self.prepared = scene.mesh.path, self.renderer.prepare(self.loader.subject(scene).surface)
        rendering = self.renderer.render(self.prepared[1], materials, view, spp=spp, seed=scene.seed)
        return Rendering(rendering.image.cpu(), rendering.coverage.cpu())
