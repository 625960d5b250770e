"""Pictures that were found good, as exemplars on disk: masked, exposed alike, like pictures of fakes, with scenes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from scipy.ndimage import distance_transform_edt, grey_erosion
from torch import Tensor

from svbrdfgan.config.choices import PluginChoice
from svbrdfgan.config.distributions import mean
from svbrdfgan.data.config import Split
from svbrdfgan.data.gather import environment_asset, mesh_asset
from svbrdfgan.data.generate import exemplar_paths, save_exemplar
from svbrdfgan.data.index import DatasetIndex
from svbrdfgan.data.photos.check import Order, Shot
from svbrdfgan.data.photos.exposure import exposure, mean_light
from svbrdfgan.data.photos.light import GLOSS, estimate, film_size, light, look, white
from svbrdfgan.data.photos.manifest import Manifest
from svbrdfgan.data.sampler import EnvironmentAsset, MeshAsset
from svbrdfgan.io import load_environment
from svbrdfgan.plugins.select import resolve_renderer
from svbrdfgan.protocols import Renderer
from svbrdfgan.scene.description import Scene, SceneEnvironment
from svbrdfgan.scene.loader import SceneLoader
from svbrdfgan.types import Environment, Materials, Mesh, Rendering, View

Place = tuple[Split, int]
"""Where an exemplar lies in its data set."""

_SPP, _SMOOTH_SPP, _LIGHT_SPP = 64, 1024, 16
_WHOLE = 0.99
_ERODED = 1 / 64
"""Of the film's height: how far a silhouette shrinks where it stands in for a mask."""


def places(manifest: Manifest) -> list[Place]:
    """The place of each picture: views of one mesh follow each other, as training wants them."""
    found: dict[int, Place] = {}
    for split in manifest.config().splits:
        chosen = [n for mesh in manifest.meshes(split) for n, e in enumerate(manifest.pictures) if e.mesh == mesh]
        found |= {number: (split, index) for index, number in enumerate(chosen)}
    return [found[number] for number in range(len(manifest.pictures))]


def develop(
    order: Order, meshes: Mapping[str, Mesh], pool: tuple[EnvironmentAsset, ...], shots: Sequence[Shot], folder: Path
) -> list[float]:
    """Writes the data set of these pictures, and gives what each was multiplied by.

    What cannot be developed is noted among the order's faults.
    """
    plan = _plan(order.manifest, meshes, pool, folder)
    room = _Darkroom.open(order, plan, folder)
    order.display.begin("exemplars", len(shots))
    exposures = [0.0] * len(shots)
    at = places(order.manifest)
    for number in sorted(range(len(shots)), key=at.__getitem__):  # a mesh is prepared once
        with order.faults.about(f"pictures[{number}]: {shots[number].entry.file}"):
            exposures[number] = room.develop(shots[number], number, exemplar_paths(folder, *at[number]))
        order.display.advance()
    plan.save(folder)
    return exposures


def _plan(
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
class _Darkroom:
    """What all pictures need.

    Attributes:
        chosen: the renderer's name and options.
        meshes: the data set's, by the manifest's file.
        lights: those that pictures name, by file; the mean by None.
        mean: the mean light of the pool, which stands for the unknown.
        prepared: the surface of the last picture, which is likely that of the next.
    """

    manifest: Manifest
    loader: SceneLoader
    renderer: Renderer[Any]
    chosen: PluginChoice
    meshes: dict[str, MeshAsset]
    lights: dict[str | None, SceneEnvironment]
    mean: Float[Tensor, "rows cols 3"]
    prepared: tuple[str, Any] | None = None

    @classmethod
    def open(cls, order: Order, plan: DatasetIndex, folder: Path) -> _Darkroom:
        manifest, base = order.manifest, order.base
        config, rows = plan.config, plan.config.environment_rows
        files = [file for split in config.splits for file in manifest.meshes(split)]
        assets = [mesh for split in config.splits for mesh in plan.meshes[split]]
        unknown = mean_light(plan.sampler("train"), folder)
        asset = environment_asset("mean of the pool", unknown, rows, folder).asset
        lights: dict[str | None, SceneEnvironment] = {None: SceneEnvironment(asset=asset)}
        for file in {entry.environment for entry in manifest.pictures if entry.environment}:
            known = environment_asset(f"own {Path(file).stem}", load_environment(base / file), rows, folder)
            scale = known.normalisation * max(mean(config.environment_brightness), 1e-6)
            lights[file] = SceneEnvironment(asset=known.asset, scale=scale)
        renderer, chosen = resolve_renderer(manifest.renderer)
        return cls(
            manifest, SceneLoader(folder), renderer, chosen, dict(zip(files, assets, strict=True)), lights, unknown
        )

    def develop(self, shot: Shot, number: int, paths: tuple[Path, Path]) -> float:
        """Writes one exemplar, and gives what the picture was multiplied by."""
        scene = self._scene(shot, number)
        clean = self._clean(scene)
        masked = _masked(shot, clean)
        factor = exposure(masked, clean)
        exposed = Rendering(masked.image * factor, masked.coverage)
        if shot.entry.environment is None and self.manifest.light == "estimated":
            scene = scene.model_copy(update={"environment": self._light(scene, exposed)})
        bare = _completed(exposed, clean.coverage, self._veil(scene))
        save_exemplar(paths[0], Rendering(bare.image * self._noise(scene), bare.coverage))
        scene.save(paths[1])
        return factor

    def _light(self, scene: Scene, exposed: Rendering) -> SceneEnvironment:
        """The scene's own light, as its picture tells it."""
        subject, (width, height) = self.loader.subject(scene), film_size(scene.width, scene.height)
        prepared, seed = self._prepared(scene), scene.seed

        def shoot(materials: Materials, radiance: Float[Tensor, "rows cols 3"]) -> Rendering:
            view = View(scene.camera.camera(), Environment(radiance), width, height)
            return _on_cpu(self.renderer.render(prepared, materials, view, spp=_LIGHT_SPP, seed=seed))

        evidence = look(exposed, shoot, subject.materials(scene.materials, None), subject.learnable, self.mean)
        found = light(self.mean, estimate(evidence, self.manifest.weathering_color))
        rows, folder = self.manifest.environment_rows, self.loader.folder
        return SceneEnvironment(asset=environment_asset(f"light of picture {scene.seed}", found, rows, folder).asset)

    def _scene(self, shot: Shot, number: int) -> Scene:
        manifest, entry = self.manifest, shot.entry
        width, height = manifest.image
        mesh, paint = self.meshes[entry.mesh], manifest.base_paint(entry)
        turn = {"rotation_degrees": entry.environment_rotation_degrees}
        return Scene(
            mesh=mesh.asset,
            environment=self.lights[entry.environment].model_copy(update=turn),
            camera=shot.camera,
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

    def _clean(self, scene: Scene) -> Rendering:
        """The scene without weathering."""
        return self._picture(scene, self.loader.subject(scene).materials(scene.materials, None), _SPP)

    def _veil(self, scene: Scene) -> Float[Tensor, "height width 3"]:
        """What the learnable parts' gloss adds to the picture, roughly."""
        subject = self.loader.subject(scene)
        return GLOSS * self._picture(scene, white(subject.learnable, len(subject.surface.parts)), _SMOOTH_SPP).image

    def _noise(self, scene: Scene) -> Float[Tensor, "height width 3"]:
        """A factor of one on average: what `_SPP` samples in each pixel make of a white mesh."""
        count = len(self.loader.subject(scene).surface.parts)
        some, many = (self._picture(scene, white(range(count), count), spp).image for spp in (_SPP, _SMOOTH_SPP))
        return torch.where(many > 0, some / many, 1.0)

    def _picture(self, scene: Scene, materials: Materials, spp: int) -> Rendering:
        view = self.loader.view(scene)
        return _on_cpu(self.renderer.render(self._prepared(scene), materials, view, spp=spp, seed=scene.seed))

    def _prepared(self, scene: Scene) -> Any:
        """The scene's surface, as the renderer wants it."""
        if self.prepared is None or self.prepared[0] != scene.mesh.path:
            self.prepared = scene.mesh.path, self.renderer.prepare(self.loader.subject(scene).surface)
        return self.prepared[1]


def _on_cpu(made: Rendering) -> Rendering:
    return Rendering(made.image.cpu(), made.coverage.cpu())


def _masked(shot: Shot, clean: Rendering) -> Rendering:
    """The picture by its mask; without one, by the mesh's silhouette, shrunk.

    So much of the camera's error does no harm then: what lies beside the mesh's edge is another thing.
    """
    image, coverage = shot.film[:3].permute(1, 2, 0), shot.film[3]
    if shot.masked:
        return Rendering(image, coverage)
    reach = 1 + 2 * max(1, round(_ERODED * len(coverage)))
    silhouette = torch.from_numpy(grey_erosion(clean.coverage.numpy(), size=(reach, reach))) * (coverage > 0.999)
    return Rendering(image * silhouette.unsqueeze(-1), silhouette)


def _completed(
    taken: Rendering, coverage: Float[Tensor, "height width"], veil: Float[Tensor, "height width 3"]
) -> Rendering:
    """The picture without the veil, in the mesh's own silhouette, lest outlines tell it from the pictures of fakes.

    What mask and silhouette do not have in common takes the colour of the nearest pixel that they have.
    """
    known = torch.minimum(taken.coverage, coverage) > _WHOLE
    _, (row, col) = distance_transform_edt(~known.numpy(), return_indices=True)
    bare = (taken.image - veil).clamp(min=0) / taken.coverage.clamp(min=_WHOLE).unsqueeze(-1)
    return Rendering(bare[row, col] * coverage.unsqueeze(-1), coverage)
