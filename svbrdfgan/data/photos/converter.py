"""Converts one picture to an exemplar: exposed, its light estimated, made comparable to rendered images."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float
from numpy import ndarray
from scipy.ndimage import grey_erosion
from torch import Tensor

from svbrdfgan.config.choices import PluginChoice
from svbrdfgan.config.distributions import mean
from svbrdfgan.data.config import ELEVATION
from svbrdfgan.data.gather import environment_asset
from svbrdfgan.data.index import DatasetIndex
from svbrdfgan.data.photos.bootstrap import Picture, flash_errors, simulated_errors
from svbrdfgan.data.photos.calibrated_camera import CalibratedCamera
from svbrdfgan.data.photos.check import RectifiedPhoto
from svbrdfgan.data.photos.exposure import exposure_factor, mean_light
from svbrdfgan.data.photos.light import Estimate, Evidence, environment, estimate_light, gather_evidence
from svbrdfgan.data.photos.manifest import Manifest
from svbrdfgan.data.photos.pairs import FlashShading, divided, reflectance_of_pair, relit, shading_of_pair
from svbrdfgan.data.photos.picture_renderer import SPP, PictureRenderer, Shaded
from svbrdfgan.data.reflectance_errors import no_errors
from svbrdfgan.data.sampler import ConfigSampler, MeshAsset, clamped
from svbrdfgan.data.trained_model import TrainedModel
from svbrdfgan.errors import AssetError
from svbrdfgan.geometry.camera_hits import CameraHits, camera_hits
from svbrdfgan.geometry.texels import nearest_texels
from svbrdfgan.io.environment import load_environment
from svbrdfgan.plugins.select import resolve_renderer
from svbrdfgan.scene.description import OrbitCamera, Scene, SceneEnvironment, SceneWeathering
from svbrdfgan.scene.loader import SceneLoader
from svbrdfgan.types import RGBA, Camera, Environment, Layer, Materials, Rendering, View

Film = Float[Tensor, "4 height width"]
Errors = Float[Tensor, "draws height width 8"]

_EXPECTED = 12
"""Draws of a model whose mean says what pictures are expected to show."""
_WHOLE = 0.99
"""Coverage from which a pixel counts as filled."""
_CALIBRATED_DEGREES = 0.1
_REFINED_DEGREES = 0.5
"""How far calibrated and refined cameras may be off (`docs/lab/own-pictures.md` has the numbers)."""
_EROSION = 1 / 64
"""How far a silhouette is eroded where it replaces a mask, as a share of the image's height."""
_FAINTEST = 1e-3
"""Of a flash relative to one that fits the clean mesh, so that it can be divided by."""
_MEASURED = 0.03
"""Standard deviation of the logarithm of how bright a flash was measured to be."""


@dataclass(frozen=True)
class EstimatedLight:
    """The light of a picture, before it is turned with the camera of a turntable, and the gain that fits it."""

    environment: SceneEnvironment
    gain: float


@dataclass(frozen=True, eq=False)
class Converted:
    """An exemplar.

    Attributes:
        scene: that it shows.
        picture: before noise.
        exposure: the factor on the picture's linear values.
        errors: that its import may have; None if nobody asked.
    """

    scene: Scene
    picture: Rendering
    exposure: float
    errors: Errors | None


@dataclass
class Converter:
    """Converts pictures one by one.

    Attributes:
        chosen: the renderer's name and options.
        meshes: the data set's meshes, by their file in the manifest.
        lights: the environments that pictures name, by file; the mean light by None.
        mean: the mean light of the pool, which replaces unknown light.
        sampler: draws lights of the pool.
        weatherings: that the pictures are expected to show; none if nobody knows.
        painted: what scenes have in which the model of these weatherings paints.
        expected: the last picture's mesh and layers of these weatherings.
    """

    manifest: Manifest
    loader: SceneLoader
    renders: PictureRenderer
    chosen: PluginChoice
    meshes: dict[str, MeshAsset]
    lights: dict[str | None, SceneEnvironment]
    mean: Float[Tensor, "rows cols 3"]
    sampler: ConfigSampler
    weatherings: Sequence[SceneWeathering]
    painted: Mapping[str, Any]
    expected: tuple[str, list[Layer]] | None = None

    @classmethod
    def open(
        cls, manifest: Manifest, base: Path, index: DatasetIndex, folder: Path, model: TrainedModel | None
    ) -> Converter:
        """The converter of a manifest's pictures, which stores what their scenes need.

        Args:
            base: the folder that the manifest's files are relative to.
            model: says which weathering the pictures are expected to show.
        """
        config, rows = index.config, index.config.environment_rows
        files = [file for split in config.splits for file in manifest.meshes(split)]
        assets = [mesh for split in config.splits for mesh in index.meshes[split]]
        sampler = index.sampler("train")
        unknown = mean_light(sampler, folder)
        asset = environment_asset("mean of the pool", unknown, rows, folder).asset
        lights: dict[str | None, SceneEnvironment] = {None: SceneEnvironment(asset=asset)}
        for file in {entry.environment for entry in manifest.pictures if entry.environment}:
            known = environment_asset(f"own {Path(file).stem}", load_environment(base / file), rows, folder)
            scale = known.normalisation * max(mean(config.environment_brightness), 1e-6)
            lights[file] = SceneEnvironment(asset=known.asset, scale=scale)
        renderer, chosen = resolve_renderer(manifest.renderer)
        stored = dict(zip(files, assets, strict=True))
        weatherings: Sequence[SceneWeathering] = ()
        painted: dict[str, Any] = {}
        if model is not None:
            weatherings = model.weatherings(model.store(folder), _EXPECTED)
            painted = {"texture": model.trained_on.texture, "maps": dict.fromkeys(model.trained_on.maps)}
        loader = SceneLoader(folder)
        renders = PictureRenderer(loader, renderer)
        return cls(manifest, loader, renders, chosen, stored, lights, unknown, sampler, weatherings, painted)

    def convert(self, photo: RectifiedPhoto, number: int, shared: EstimatedLight | None) -> Converted:
        """Converts one picture.

        Args:
            shared: the light of the picture's group, if it has one.

        Raises:
            AssetError: the picture shows too little.
        """
        scene = self._scene(photo, number)
        found = self._flashed(photo, scene) if photo.entry.without_flash else self._lit(photo, scene, number, shared)
        noisy = found.picture.image * self.renders.noise(found.scene)
        return replace(found, picture=Rendering(noisy, found.picture.coverage))

    def evidence(self, photo: RectifiedPhoto, number: int) -> Evidence:
        """What a picture says of its light, before it is turned with the camera."""
        scene = self._scene(photo, number)
        return self._evidence(photo, scene, self._exposed(photo, scene)[1])

    def light(self, name: str, pictures: Sequence[Evidence]) -> list[EstimatedLight]:
        """The light that all of these pictures show, stored under this name; one for each picture, with its gain."""
        estimate = estimate_light(pictures, self.manifest.weathering_color)
        stored = self._stored(name, estimate)
        return [EstimatedLight(stored, gain) for gain in estimate.gains.tolist()]

    def _lit(self, photo: RectifiedPhoto, scene: Scene, number: int, shared: EstimatedLight | None) -> Converted:
        """A picture in the light of its surroundings."""
        clean, exposed, factor = self._exposed(photo, scene)
        errors, light = None, shared
        if self.manifest.bootstrap or (shared is None and self._estimates(photo)):
            errors, light = self._studied(photo, scene, exposed, shared, number)
        if light is not None:
            turned = light.environment.model_copy(update={"rotation_degrees": math.degrees(_turn(photo))})
            scene, factor = scene.model_copy(update={"environment": turned}), factor * light.gain
        after = _masked(photo.film, photo.masked, clean, factor)
        if photo.before is None:
            return Converted(scene, _filled(after, clean.coverage, self.renders.gloss(scene)), factor, errors)
        before, made = _masked(photo.before, photo.masked, clean, factor), self.renders.shaded(scene)
        shading, matt = shading_of_pair(before.image, made.base, made.shading)
        reflectance = reflectance_of_pair(after.image, before.image, made.base, shading)
        known = matt & (torch.minimum(after.coverage, clean.coverage) > _WHOLE)
        if not known.any():
            raise AssetError("'before' shows nothing but highlights, or not the mesh: leave it out.")
        return Converted(scene, relit(reflectance, known, made.shading, made.others), factor, errors)

    def _studied(
        self, photo: RectifiedPhoto, scene: Scene, exposed: Rendering, shared: EstimatedLight | None, number: int
    ) -> tuple[Errors | None, EstimatedLight | None]:
        """How far imports of pictures like this one are off; and its light, if it is estimated."""
        count, estimates = self.manifest.bootstrap, self._estimates(photo)
        try:
            evidence = self._evidence(photo, scene, exposed)
        except AssetError:
            if estimates:
                raise
            return no_errors(scene.height, scene.width).expand(count, -1, -1, -1), None
        estimate, errors = estimate_light([evidence], self.manifest.weathering_color), None
        if count:
            errors = torch.stack([self._errors(photo, scene, evidence, estimate, draw) for draw in range(count)])
        if shared is None and estimates:
            return errors, EstimatedLight(self._stored(f"light of picture {number}", estimate), 1.0)
        return errors, shared

    def _stored(self, name: str, estimate: Estimate) -> SceneEnvironment:
        radiance, rows = environment(self.mean, estimate.weights), self.manifest.environment_rows
        return SceneEnvironment(asset=environment_asset(name, radiance, rows, self.loader.folder).asset)

    def _errors(
        self, photo: RectifiedPhoto, scene: Scene, evidence: Evidence, estimate: Estimate, draw: int
    ) -> Float[Tensor, "height width 8"]:
        """The errors of importing a picture that is simulated after this one, with its light estimated alone."""
        rng = np.random.default_rng([scene.seed, draw])
        own = self.loader.view(scene)
        camera = _elsewhere(scene.camera, self._camera_error(photo), rng)
        light = own.environment
        if photo.entry.environment is None:
            drawn = scene.model_copy(update={"environment": self.sampler.draw_environment(rng)})
            light = self.loader.view(drawn).environment

        def believe(seen: Evidence) -> Environment:
            if not self._estimates(photo):
                return own.environment
            weights = estimate_light([seen], self.manifest.weathering_color).weights
            return Environment(environment(self.mean, weights), _turn(photo))

        def render(materials: Materials, view: View) -> Float[Tensor, "height width 3"]:
            return self.renders.view(scene, materials, view)

        picture = self._picture(scene, own.camera, evidence, estimate)
        clean = None if photo.before is None else self.renders.clean(scene)
        return simulated_errors(picture, light, camera.camera(), believe, render, rng, clean)

    def _picture(self, scene: Scene, camera: Camera, evidence: Evidence, estimate: Estimate) -> Picture:
        size, dirt = (scene.width, scene.height), self.manifest.weathering_color
        return Picture(self.loader.subject(scene), camera, size, evidence, estimate.shares, dirt)

    def _flashed(self, photo: RectifiedPhoto, scene: Scene) -> Converted:
        """A picture in the light of a flash, shown in the mean light."""
        made, size = self.renders.shaded(scene), (scene.width, scene.height)
        surface, learnable = self.loader.subject(scene).surface, self.loader.subject(scene).learnable
        hits = camera_hits(surface, scene.camera.camera(), *size)
        flash = FlashShading.of(hits)
        picture = _masked(photo.film, photo.masked, made.others)
        lit = (made.shading > 0).all(dim=-1) & torch.from_numpy(np.isin(hits.part, learnable))
        known = flash.clear & lit & (torch.minimum(picture.coverage, made.others.coverage) > _WHOLE)
        if not known.any():
            raise AssetError("its flash lights no learnable part: correct the camera, or leave out 'without_flash'.")
        power, count, dirt = photo.entry.flash, self.manifest.bootstrap, self.manifest.weathering_color
        evidence, factor = self._flash_evidence(scene, made, flash, picture, known)
        estimate = estimate_light([evidence], dirt)
        used = _brightness(estimate) / factor if power is None else np.asarray(power)
        errors = None
        if count:
            seen = self._picture(scene, scene.camera.camera(), evidence, estimate)

            def gain(simulated: Evidence, rng: np.random.Generator) -> Float[ndarray, " 3"]:
                if power is not None:
                    return np.exp(rng.normal(scale=_MEASURED, size=3))
                return 1.0 / _brightness(estimate_light([simulated], dirt))

            errors = torch.stack([self._flash_errors(photo, scene, flash, seen, gain, draw) for draw in range(count)])
        reflectance = flash.reflectance(picture.image, torch.from_numpy(used).float())
        return Converted(scene, relit(reflectance, known, made.shading, made.others), float(1 / used.mean()), errors)

    def _flash_evidence(
        self,
        scene: Scene,
        made: Shaded,
        flash: FlashShading,
        picture: Rendering,
        known: Bool[Tensor, "height width"],
    ) -> tuple[Evidence, float]:
        """What a picture says of the flash, which is its only lobe of light; and the exposure of its radiance."""
        lit = flash.values[..., None].expand(-1, -1, 3)
        factor = exposure_factor(Rendering(picture.image, known.float()), Rendering(made.base * lit, known.float()))
        drawn = [
            divided(self.renders.render(scene, materials).image, made.shading)
            for materials in self.renders.weathered(scene, self._expected(scene))
        ]
        radiance, base, shown, *draws = (
            part[known].double().numpy() for part in (picture.image * factor, made.base, lit, *drawn)
        )
        return (
            Evidence(radiance, base, shown[..., None], known.numpy(), np.array(draws).reshape(-1, *base.shape)),
            factor,
        )

    def _flash_errors(
        self,
        photo: RectifiedPhoto,
        scene: Scene,
        flash: FlashShading,
        picture: Picture,
        gain: Callable[[Evidence, np.random.Generator], Float[ndarray, " 3"]],
        draw: int,
    ) -> Float[Tensor, "height width 8"]:
        rng = np.random.default_rng([scene.seed, draw])
        camera = _elsewhere(scene.camera, self._camera_error(photo), rng).camera()
        hits: CameraHits = camera_hits(picture.subject.surface, camera, scene.width, scene.height)
        return flash_errors(picture, flash, hits, gain, rng)

    def _estimates(self, photo: RectifiedPhoto) -> bool:
        """Whether the picture's light is estimated."""
        return photo.entry.environment is None and self.manifest.light == "estimated"

    def _camera_error(self, photo: RectifiedPhoto) -> float:
        """How far the picture's camera may be off, degrees."""
        if photo.refinement is not None:
            return _REFINED_DEGREES
        calibrated = isinstance(photo.entry.camera, CalibratedCamera)
        return _CALIBRATED_DEGREES if calibrated else self.manifest.camera_error_degrees

    def _exposed(self, photo: RectifiedPhoto, scene: Scene) -> tuple[Rendering, Rendering, float]:
        """The clean mesh, the picture that says most of its light, exposed likewise, and the factor that does that."""
        clean = self.renders.render(scene, self.renders.clean(scene))
        masked = _masked(photo.film if photo.before is None else photo.before, photo.masked, clean)
        factor = exposure_factor(masked, clean)
        return clean, Rendering(masked.image * factor, masked.coverage), factor

    def _evidence(self, photo: RectifiedPhoto, scene: Scene, exposed: Rendering) -> Evidence:
        clean, learnable = self.renders.clean(scene), self.loader.subject(scene).learnable
        expected = [clean] if photo.before is not None else self.renders.weathered(scene, self._expected(scene))
        render = self.renders.in_light(scene, _turn(photo))
        return gather_evidence(exposed, render, clean, learnable, self.mean, expected)

    def _expected(self, scene: Scene) -> list[Layer]:
        """Base colour of the layers that the picture is expected to show."""
        if self.expected is None or self.expected[0] != scene.mesh.path:
            there = scene.model_copy(update=self.painted)
            layers = [self.loader.paint(there, weathering) for weathering in self.weatherings]
            self.expected = scene.mesh.path, [Layer(layer.values[..., :RGBA]) for layer in layers]
        return self.expected[1]

    def _scene(self, photo: RectifiedPhoto, number: int) -> Scene:
        manifest, entry = self.manifest, photo.entry
        width, height = manifest.image
        mesh, paint = self.meshes[entry.mesh], manifest.base_paint(entry)
        turn = {"rotation_degrees": entry.environment_rotation_degrees}
        return Scene(
            mesh=mesh.asset,
            environment=self.lights[entry.environment].model_copy(update=turn),
            camera=photo.camera,
            width=width,
            height=height,
            spp=SPP,
            seed=number,
            texture=manifest.texture,
            renderer=self.chosen,
            embedding=manifest.embedding,
            learnable=manifest.learnable,
            materials={} if paint is None else dict.fromkeys(mesh.painted, paint),
            weathering="unknown",
        )


def _turn(photo: RectifiedPhoto) -> float:
    """How far the light of its group has turned about the object, radians: on a turntable, with the camera."""
    return photo.entry.heading if photo.entry.turntable else 0.0


def _brightness(flash: Estimate) -> Float[ndarray, " 3"]:
    """How bright a flash is in each channel, which is its only lobe of light."""
    return np.maximum(flash.weights[:, 0], _FAINTEST)


def _elsewhere(camera: OrbitCamera, degrees: float, rng: np.random.Generator) -> OrbitCamera:
    """A camera off by as much at most, and by as many percent of the distance."""
    azimuth, elevation, distance = rng.uniform(-degrees, degrees, size=3).tolist()
    return camera.model_copy(
        update={
            "azimuth_degrees": (camera.azimuth_degrees + azimuth) % 360.0,
            "elevation_degrees": clamped(camera.elevation_degrees + elevation, ELEVATION),
            "distance": camera.distance * (1.0 + distance / 100),
        }
    )


def _masked(film: Film, masked: bool, clean: Rendering, factor: float = 1.0) -> Rendering:
    """The picture times the factor, inside its mask or, without one, inside the mesh's eroded silhouette."""
    image, coverage = factor * film[:3].permute(1, 2, 0), film[3]
    if masked:
        return Rendering(image, coverage)
    # eroded, since a small error of the camera would otherwise let in what lies beside the mesh's edge
    reach = 1 + 2 * max(1, round(_EROSION * len(coverage)))
    silhouette = torch.from_numpy(grey_erosion(clean.coverage.numpy(), size=(reach, reach))) * (coverage > 0.999)
    return Rendering(image * silhouette.unsqueeze(-1), silhouette)


def _filled(
    photo: Rendering, coverage: Float[Tensor, "height width"], gloss: Float[Tensor, "height width 3"]
) -> Rendering:
    """The picture less the gloss, inside the mesh's rendered silhouette.

    Pixels outside of the mask take the colour of the nearest pixel inside mask and silhouette.
    """
    # the silhouette and not the mask, since the discriminator could tell exemplars by their outlines
    known = torch.minimum(photo.coverage, coverage) > _WHOLE
    row, col = nearest_texels(known.numpy())
    matt = (photo.image - gloss).clamp(min=0) / photo.coverage.clamp(min=_WHOLE).unsqueeze(-1)
    return Rendering(matt[row, col] * coverage.unsqueeze(-1), coverage)
