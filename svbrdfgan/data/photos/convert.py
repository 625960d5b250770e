"""Converts checked pictures to exemplars: masked, exposed, made comparable to rendered images, each with its scene."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from scipy.ndimage import distance_transform_edt, grey_erosion
from torch import Tensor

from svbrdfgan.config.choices import PluginChoice
from svbrdfgan.config.distributions import mean
from svbrdfgan.data.config import ELEVATION, Split
from svbrdfgan.data.exemplar_files import exemplar_paths, save_exemplar
from svbrdfgan.data.gather import environment_asset, mesh_asset
from svbrdfgan.data.index import DatasetIndex
from svbrdfgan.data.photos.bootstrap import Picture, simulated_errors
from svbrdfgan.data.photos.calibrated_camera import CalibratedCamera
from svbrdfgan.data.photos.check import ImportJob, RectifiedPhoto
from svbrdfgan.data.photos.exposure import exposure_factor, mean_light
from svbrdfgan.data.photos.light import (
    GLOSS,
    Estimate,
    Evidence,
    environment,
    estimate_light,
    evidence_size,
    gather_evidence,
    white,
)
from svbrdfgan.data.photos.manifest import Manifest
from svbrdfgan.data.reflectance_errors import errors_path, no_errors, save_errors
from svbrdfgan.data.sampler import ConfigSampler, EnvironmentAsset, MeshAsset, clamped
from svbrdfgan.data.trained_model import TrainedModel
from svbrdfgan.errors import AssetError
from svbrdfgan.io.environment import load_environment
from svbrdfgan.plugins.select import resolve_renderer
from svbrdfgan.rendering.checked_renderer import CheckedRenderer
from svbrdfgan.scene.description import OrbitCamera, Scene, SceneEnvironment, SceneWeathering
from svbrdfgan.scene.loader import SceneLoader
from svbrdfgan.types import RGBA, Environment, Layer, Materials, Mesh, Rendering, View

Place = tuple[Split, int]
"""Where an exemplar lies in its data set."""

_SPP = 64
"""Samples per pixel of the clean rendering and of simulated pictures; the noise of as many is measured."""
_SMOOTH_SPP = 1024
"""Samples per pixel of renderings that count as free of noise."""
_EXPECTED = 12
"""Draws of a model whose mean says what pictures are expected to show."""
_LIGHT_SPP = 16
"""Samples per pixel of each lobe of light: estimates are sums over many pixels."""
_MOST_EVIDENCE = 40_000
"""Pixels, about, that the light of a group is estimated from."""
_LEAST_EVIDENCE = 100
"""The same, of each of its pictures."""
_WHOLE = 0.99
"""Coverage from which a pixel counts as filled."""
_CALIBRATED_DEGREES = 0.1
_REFINED_DEGREES = 0.5
"""How far calibrated and refined cameras may be off (`docs/lab/own-pictures.md` has the numbers)."""
_EROSION = 1 / 64
"""How far a silhouette is eroded where it replaces a mask, as a share of the image's height."""


@dataclass(frozen=True)
class EstimatedLight:
    """The light of a picture, before it is turned with the camera of a turntable, and the gain that fits it."""

    environment: SceneEnvironment
    gain: float


def places(manifest: Manifest) -> list[Place]:
    """The place of each picture in the data set. Views of one mesh follow each other, as training requires."""
    found: dict[int, Place] = {}
    for split in manifest.config().splits:
        chosen = [n for mesh in manifest.meshes(split) for n, e in enumerate(manifest.pictures) if e.mesh == mesh]
        found |= {number: (split, index) for index, number in enumerate(chosen)}
    return [found[number] for number in range(len(manifest.pictures))]


def convert_photos(
    job: ImportJob,
    meshes: Mapping[str, Mesh],
    pool: tuple[EnvironmentAsset, ...],
    photos: Sequence[RectifiedPhoto],
    folder: Path,
    model: TrainedModel | None = None,
) -> dict[int, float]:
    """Writes the data set, and returns the exposure factor of each picture in it; the job notes why others are missing.

    Args:
        model: says which weathering the pictures are expected to show.
    """
    index = _index(job.manifest, meshes, pool, folder)
    converter = _Converter.open(job, index, folder, model)
    exposures: dict[int, float] = {}
    at = places(job.manifest)
    order = sorted(range(len(photos)), key=at.__getitem__)  # a mesh is prepared once
    shared = _shared_lights(job, converter, photos, order)
    job.display.begin("exemplars", len(photos))
    for number in order:
        with job.picture(number):
            if number not in job.unusable:
                exposures[number] = converter.convert(photos[number], number, at[number], shared.get(number))
        job.display.advance()
    job.require_some(exposures)
    kept = job.manifest.keeping(exposures)
    if len(exposures) < len(photos):
        _close_ranks([at[number] for number in sorted(exposures)], places(kept), folder)
        index = _index(kept, meshes, pool, folder)
    index.save(folder)
    return exposures


def _close_ranks(before: Sequence[Place], after: Sequence[Place], folder: Path) -> None:
    """Renames the files of exemplars where others before them are missing, in order, so that no name is taken."""
    for old, new in sorted(zip(before, after, strict=True)):
        for path, wanted in zip(_files(folder, old), _files(folder, new), strict=True):
            if path.is_file():
                path.rename(wanted)


def _files(folder: Path, place: Place) -> tuple[Path, ...]:
    return (*exemplar_paths(folder, *place), errors_path(folder, *place))


def _shared_lights(
    job: ImportJob, converter: _Converter, photos: Sequence[RectifiedPhoto], order: Sequence[int]
) -> dict[int, EstimatedLight]:
    """The light of each picture of a group, by number. Pictures that say too little are reported, and left out."""
    groups: dict[str, list[int]] = {}
    for number in order:
        if (name := photos[number].entry.light_group) is not None:
            groups.setdefault(name, []).append(number)
    if groups:
        job.display.begin("light of groups", sum(map(len, groups.values())))
    lights: dict[int, EstimatedLight] = {}
    for group, members in enumerate(groups.values()):
        found: dict[int, Evidence] = {}
        for number in members:
            with job.picture(number):
                evidence = converter.evidence(photos[number], number)
                found[number] = evidence.thinned(max(_LEAST_EVIDENCE, _MOST_EVIDENCE // len(members)))
            job.display.advance()
        if found:
            estimated = converter.light(f"light of group {group}", list(found.values()))
            lights |= dict(zip(found, estimated, strict=True))
    return lights


def _index(
    manifest: Manifest, meshes: Mapping[str, Mesh], pool: tuple[EnvironmentAsset, ...], folder: Path
) -> DatasetIndex:
    config = manifest.config()
    views = [entry.mesh for entry in manifest.pictures]

    def asset(file: str) -> MeshAsset:
        stored = mesh_asset(Path(file).stem, meshes[file], config, folder)
        return stored.model_copy(update={"views": views.count(file)})

    assets = {split: tuple(asset(file) for file in manifest.meshes(split)) for split in config.splits}
    return DatasetIndex(config=config, meshes=assets, environments=dict.fromkeys(config.splits, pool))


@dataclass
class _Converter:
    """Converts pictures one by one.

    Attributes:
        chosen: the renderer's name and options.
        meshes: the data set's meshes, by their file in the manifest.
        lights: the environments that pictures name, by file; the mean light by None.
        mean: the mean light of the pool, which replaces unknown light.
        sampler: draws lights of the pool.
        weatherings: that the pictures are expected to show; none if nobody knows.
        painted: what scenes have in which the model of these weatherings paints.
        prepared: the last picture's mesh and prepared surface: the next picture usually shows the same mesh.
        expected: the last picture's mesh and layers of these weatherings.
    """

    manifest: Manifest
    loader: SceneLoader
    renderer: CheckedRenderer
    chosen: PluginChoice
    meshes: dict[str, MeshAsset]
    lights: dict[str | None, SceneEnvironment]
    mean: Float[Tensor, "rows cols 3"]
    sampler: ConfigSampler
    weatherings: Sequence[SceneWeathering]
    painted: Mapping[str, Any]
    prepared: tuple[str, Any] | None = None
    expected: tuple[str, list[Layer]] | None = None

    @classmethod
    def open(cls, job: ImportJob, index: DatasetIndex, folder: Path, model: TrainedModel | None) -> _Converter:
        manifest, base = job.manifest, job.base
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
        return cls(manifest, loader, renderer, chosen, stored, lights, unknown, sampler, weatherings, painted)

    def convert(self, photo: RectifiedPhoto, number: int, place: Place, shared: EstimatedLight | None) -> float:
        """Writes one exemplar and its scene, and returns the exposure factor.

        Args:
            shared: the light of the picture's group, if it has one.
        """
        picture, record = exemplar_paths(self.loader.folder, *place)
        scene = self._scene(photo, number)
        clean, exposed, factor = self._exposed(photo, scene)
        if self.manifest.bootstrap or (shared is None and self._estimates(photo)):
            shared = self._studied(photo, scene, exposed, shared, number, place)
        if shared is not None:
            turned = shared.environment.model_copy(update={"rotation_degrees": math.degrees(_turn(photo))})
            scene, factor = scene.model_copy(update={"environment": turned}), factor * shared.gain
            exposed = Rendering(exposed.image * shared.gain, exposed.coverage)
        matt = _fill_silhouette(exposed, clean.coverage, self._gloss(scene))
        save_exemplar(picture, Rendering(matt.image * self._noise(scene), matt.coverage))
        scene.save(record)
        return factor

    def _studied(
        self,
        photo: RectifiedPhoto,
        scene: Scene,
        exposed: Rendering,
        shared: EstimatedLight | None,
        number: int,
        place: Place,
    ) -> EstimatedLight | None:
        """The light of the picture if it is estimated; and writes how far imports of pictures like it are off."""
        count, path = self.manifest.bootstrap, errors_path(self.loader.folder, *place)
        try:
            evidence = self._evidence(scene, exposed, _turn(photo))
        except AssetError:
            if self._estimates(photo):
                raise
            save_errors(path, no_errors(scene.height, scene.width).expand(count, -1, -1, -1))
            return None
        estimate = estimate_light([evidence], self.manifest.weathering_color)
        if count:
            save_errors(
                path, torch.stack([self._errors(photo, scene, evidence, estimate, draw) for draw in range(count)])
            )
        if shared is None and self._estimates(photo):
            return EstimatedLight(self._stored(f"light of picture {number}", estimate), 1.0)
        return shared

    def evidence(self, photo: RectifiedPhoto, number: int) -> Evidence:
        """What a picture says of its light, before it is turned with the camera."""
        scene = self._scene(photo, number)
        return self._evidence(scene, self._exposed(photo, scene)[1], _turn(photo))

    def light(self, name: str, pictures: Sequence[Evidence]) -> list[EstimatedLight]:
        """The light that all of these pictures show, stored under this name; one for each picture, with its gain."""
        estimate = estimate_light(pictures, self.manifest.weathering_color)
        stored = self._stored(name, estimate)
        return [EstimatedLight(stored, gain) for gain in estimate.gains.tolist()]

    def _stored(self, name: str, estimate: Estimate) -> SceneEnvironment:
        radiance, rows = environment(self.mean, estimate.weights), self.manifest.environment_rows
        return SceneEnvironment(asset=environment_asset(name, radiance, rows, self.loader.folder).asset)

    def _errors(
        self, photo: RectifiedPhoto, scene: Scene, evidence: Evidence, estimate: Estimate, draw: int
    ) -> Float[Tensor, "height width 8"]:
        """The errors of importing a picture that is simulated after this one, with its light estimated alone."""
        rng = np.random.default_rng([scene.seed, draw])
        manifest, own, prepared = self.manifest, self.loader.view(scene), self._prepared(scene)
        camera = _elsewhere(scene.camera, self._camera_error(photo), rng)
        light = own.environment
        if photo.entry.environment is None:
            drawn = scene.model_copy(update={"environment": self.sampler.draw_environment(rng)})
            light = self.loader.view(drawn).environment

        def believe(seen: Evidence) -> Environment:
            if not self._estimates(photo):
                return own.environment
            weights = estimate_light([seen], manifest.weathering_color).weights
            return Environment(environment(self.mean, weights), _turn(photo))

        def render(materials: Materials, view: View) -> Float[Tensor, "height width 3"]:
            return self.renderer.render(prepared, materials, view, spp=_SPP, seed=scene.seed).image.cpu()

        subject, size = self.loader.subject(scene), (scene.width, scene.height)
        picture = Picture(subject, own.camera, size, evidence, estimate.shares, manifest.weathering_color)
        return simulated_errors(picture, light, camera.camera(), believe, render, rng)

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
        """The clean rendering, the picture exposed like it, and the factor that does that."""
        clean = self._render_clean(scene)
        masked = _masked(photo, clean)
        factor = exposure_factor(masked, clean)
        return clean, Rendering(masked.image * factor, masked.coverage), factor

    def _evidence(self, scene: Scene, exposed: Rendering, turn: float = 0.0) -> Evidence:
        subject, (width, height) = self.loader.subject(scene), evidence_size(scene.width, scene.height)
        prepared, seed = self._prepared(scene), scene.seed

        def render(materials: Materials, radiance: Float[Tensor, "rows cols 3"]) -> Rendering:
            view = View(scene.camera.camera(), Environment(radiance, turn), width, height)
            return _on_cpu(self.renderer.render(prepared, materials, view, spp=_LIGHT_SPP, seed=seed))

        clean = subject.materials(base_colors=scene.materials)
        weathered = [subject.materials(layer, base_colors=scene.materials) for layer in self._expected(scene)]
        return gather_evidence(exposed, render, clean, subject.learnable, self.mean, weathered)

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
            spp=_SPP,
            seed=number,
            texture=manifest.texture,
            renderer=self.chosen,
            embedding=manifest.embedding,
            learnable=manifest.learnable,
            materials={} if paint is None else dict.fromkeys(mesh.painted, paint),
            weathering="unknown",
        )

    def _render_clean(self, scene: Scene) -> Rendering:
        """The scene without weathering."""
        return self._render(scene, self.loader.subject(scene).materials(base_colors=scene.materials), _SPP)

    def _gloss(self, scene: Scene) -> Float[Tensor, "height width 3"]:
        """The radiance that gloss of the learnable parts adds to the picture, approximately."""
        subject = self.loader.subject(scene)
        return GLOSS * self._render(scene, white(subject.learnable, len(subject.surface.parts)), _SMOOTH_SPP).image

    def _noise(self, scene: Scene) -> Float[Tensor, "height width 3"]:
        """The relative noise of `_SPP` samples per pixel, of mean one, measured on a white mesh."""
        count = len(self.loader.subject(scene).surface.parts)
        noisy, smooth = (self._render(scene, white(range(count), count), spp).image for spp in (_SPP, _SMOOTH_SPP))
        return torch.where(smooth > 0, noisy / smooth, 1.0)

    def _render(self, scene: Scene, materials: Materials, spp: int) -> Rendering:
        view = self.loader.view(scene)
        return _on_cpu(self.renderer.render(self._prepared(scene), materials, view, spp=spp, seed=scene.seed))

    def _prepared(self, scene: Scene) -> Any:
        """The scene's surface, prepared by the renderer."""
        if self.prepared is None or self.prepared[0] != scene.mesh.path:
            self.prepared = scene.mesh.path, self.renderer.prepare(self.loader.subject(scene).surface)
        return self.prepared[1]


def _turn(photo: RectifiedPhoto) -> float:
    """How far the light of its group has turned about the object, radians: on a turntable, with the camera."""
    return photo.entry.heading if photo.entry.turntable else 0.0


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


def _on_cpu(rendering: Rendering) -> Rendering:
    return Rendering(rendering.image.cpu(), rendering.coverage.cpu())


def _masked(photo: RectifiedPhoto, clean: Rendering) -> Rendering:
    """The picture inside its mask or, without one, inside the mesh's eroded silhouette."""
    image, coverage = photo.film[:3].permute(1, 2, 0), photo.film[3]
    if photo.masked:
        return Rendering(image, coverage)
    # eroded, since a small error of the camera would otherwise let in what lies beside the mesh's edge
    reach = 1 + 2 * max(1, round(_EROSION * len(coverage)))
    silhouette = torch.from_numpy(grey_erosion(clean.coverage.numpy(), size=(reach, reach))) * (coverage > 0.999)
    return Rendering(image * silhouette.unsqueeze(-1), silhouette)


def _fill_silhouette(
    photo: Rendering, coverage: Float[Tensor, "height width"], gloss: Float[Tensor, "height width 3"]
) -> Rendering:
    """The picture less the gloss, inside the mesh's rendered silhouette.

    Pixels outside of the mask take the colour of the nearest pixel inside mask and silhouette.
    """
    # the silhouette and not the mask, since the discriminator could tell exemplars by their outlines
    known = torch.minimum(photo.coverage, coverage) > _WHOLE
    _, (row, col) = distance_transform_edt(~known.numpy(), return_indices=True)
    matt = (photo.image - gloss).clamp(min=0) / photo.coverage.clamp(min=_WHOLE).unsqueeze(-1)
    return Rendering(matt[row, col] * coverage.unsqueeze(-1), coverage)
