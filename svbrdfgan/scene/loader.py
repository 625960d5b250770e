"""Scene loader: from scene descriptions to the surfaces, layers and views that renderers take."""

from __future__ import annotations

import hashlib
import json
import logging
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from numpy import ndarray
from torch import Tensor

from svbrdfgan.errors import AssetError, ConfigError, EmbeddingError
from svbrdfgan.geometry.rasterize import Fragments
from svbrdfgan.io.environment import load_environment
from svbrdfgan.io.mesh import load_mesh
from svbrdfgan.networks.draw import Draw, opacity_of
from svbrdfgan.networks.generator import Generator
from svbrdfgan.networks.inputs import Wholes
from svbrdfgan.networks.saved import load_generator
from svbrdfgan.plugins.registry import load_embedding
from svbrdfgan.scene.cache import (
    load_layer,
    load_mesh_maps,
    load_subject,
    save_layer,
    save_mesh_maps,
    save_subject,
)
from svbrdfgan.scene.description import AssetRef, Scene, SceneWeathering
from svbrdfgan.scene.subject import Subject, bake_subject, make_subject
from svbrdfgan.scene.user_cache import in_user_cache
from svbrdfgan.scene.window import (
    WHOLE,
    bordered,
    find_window,
    interpolated_survey,
    place_in_whole,
    windowed,
)
from svbrdfgan.types import RGBA, Environment, Layer, Mesh, Surface, View
from svbrdfgan.weathering.layer import recipe_from_options, weather
from svbrdfgan.weathering.mesh_maps import MeshMaps, bake_mesh_maps
from svbrdfgan.weathering.recipes import Recipe
from svbrdfgan.weathering.site import Site
from svbrdfgan.weathering.survey import find_site

log = logging.getLogger(__name__)

_CACHE = "cache"
KEPT = 64
"""The most layers that a loader keeps in memory, and about the most subjects if they are windows."""


@dataclass
class SceneLoader:
    """Loads what the scenes of one folder name, each asset once. It keeps the last 64 layers or windows in memory.

    Attributes:
        folder: asset paths are relative to it.
        keep: whether subjects, mesh maps and layers are cached in files there, for the next process. What is baked of
            whole meshes is then kept in the user's cache, too, if there is one.
    """

    folder: Path
    keep: bool = True
    _subjects: dict[str, Subject] = field(default_factory=dict)
    _surfaces: dict[str, Surface] = field(default_factory=dict)
    _maps: dict[str, MeshMaps] = field(default_factory=dict)
    _sites: dict[str, Site] = field(default_factory=dict)
    _generators: dict[str, Generator] = field(default_factory=dict)
    _layers: dict[str, Layer] = field(default_factory=dict)
    _wholes: dict[str, Float[Tensor, "1 inputs rows cols"]] = field(default_factory=dict)
    _lights: dict[str, Float[Tensor, "rows cols 3"]] = field(default_factory=dict)
    _scaled: dict[str, tuple[float, Float[Tensor, "rows cols 3"]]] = field(default_factory=dict)

    def subject(self, scene: Scene) -> Subject:
        """The scene's surface, embedded and baked."""
        key = subject_key(scene)
        if key not in self._subjects:
            path = self.cache / "subjects" / f"{key}.safetensors"
            whole = None
            if scene.window is not None:
                whole = self._whole_surface(scene)
                make_room(self._subjects)
            load, save, new = partial(load_subject, whole=whole), partial(save_subject, whole=whole), not path.is_file()
            found: Subject = self._stored(path, scene, load, save, self._make_subject, baked=True)
            if new and whole is None:
                for warning in found.overlooked():
                    log.warning("%s: %s", scene.mesh.path, warning)
            self._subjects[key] = found
        return self._subjects[key]

    def with_mesh_maps(self, scene: Scene) -> Subject:
        """The scene's surface with mesh maps, for a generator that reads them."""
        return replace(self.subject(scene), mesh_maps=self.mesh_maps(scene))

    def wholes(self, scene: Scene, *, mesh_maps: bool) -> Wholes:
        """The whole map that the scene's window is cut from, of `WHOLE` texels at most, and the window's place in it.

        Args:
            mesh_maps: whether the whole map's geometry includes them.
        """
        assert scene.window is not None
        whole = _whole(scene)
        key = f"{subject_key(whole)}-{mesh_maps}"
        if key not in self._wholes:
            subject = self.with_mesh_maps(whole) if mesh_maps else self.subject(whole)
            self._wholes[key] = subject.generator_input.unsqueeze(0)
        surfaces = self.subject(scene).surface, self._whole_surface(scene)
        place = place_in_whole(*surfaces, scene.window / scene.texture)
        return Wholes(self._wholes[key], torch.zeros(1, dtype=torch.int64), torch.tensor([place]))

    def mesh_maps(self, scene: Scene) -> MeshMaps:
        """The mesh maps of the scene's surface."""
        key = subject_key(scene)
        if key not in self._maps:
            path = self.cache / "mesh_maps" / f"{key}.safetensors"
            if scene.window is not None:
                make_room(self._maps)
            self._maps[key] = self._stored(path, scene, load_mesh_maps, save_mesh_maps, self._make_maps, baked=True)
        return self._maps[key]

    def layer(self, scene: Scene) -> Layer | None:
        """The true layer of the scene's surface; None where there is none or it is unknown."""
        weathering = scene.weathering
        if not isinstance(weathering, SceneWeathering):
            return None
        # without its None: layers of recipes keep the names that they had before there were models
        key = f"{subject_key(scene)}-{_digest(weathering.model_dump(exclude_none=True), *scene.maps)}"
        if key not in self._layers:
            path = self.cache / "layers" / f"{key}.safetensors"
            make_room(self._layers)
            self._layers[key] = self._stored(
                path, scene, load_layer, save_layer, lambda scene: self.paint(scene, weathering), baked=False
            )
        return self._layers[key]

    def paint(self, scene: Scene, weathering: SceneWeathering) -> Layer:
        """The layer of a weathering on the scene's surface, painted anew: by its recipe, or by its model.

        All true layers are painted here. A layer differs by at most 2/255 between devices.

        Raises:
            ConfigError: the recipe is unknown, or has no such option; or a model is to paint a window.
            AssetError: the model's file is missing or damaged, has changed, or paints other maps than the scene has.
        """
        if weathering.model is None:
            subject, site = self.subject(scene), self.site(scene)
            layer = weather(subject.surface, subject.buffer, recipe_of(weathering), scene.maps, site=site)
            return layer if scene.window is None else replace(layer, values=bordered(layer.values))
        if scene.window is not None:
            raise ConfigError(f"{weathering.model.asset.path} paints whole layers: leave out the scene's window.")
        generator = self._generator(weathering.model.asset)
        if generator.maps != tuple(scene.maps):
            raise AssetError(
                f"{weathering.model.asset.path} paints base_color and {list(generator.maps)}, and the scene declares "
                f"{list(scene.maps)}: give it the maps that the model was trained with."
            )
        known = weathering.model.conditions
        labels = known.labels(weathering.amount, weathering.recipe)
        opacity = 1.0 if known.amount is None else opacity_of(weathering.amount)
        subject = self.with_mesh_maps(scene) if generator.mesh_maps else self.subject(scene)
        with torch.no_grad():
            painted = Draw(generator, weathering.seed, labels, opacity)(subject.generator_input.unsqueeze(0))[0]
        return Layer(painted, generator.maps)

    def site(self, scene: Scene) -> Site:
        """The scene's site, which recipes go by, on the GPU if there is one.

        Only the last one is kept: sites are slow to find, and large.
        """
        key = subject_key(scene)
        if key not in self._sites:
            self._sites.clear()
            subject, maps = self.subject(scene), self.mesh_maps(scene)
            site = find_site(subject.surface, subject.buffer, maps, tangents="normal" in scene.maps)
            self._sites[key] = site.to("cuda", torch.float64) if torch.cuda.is_available() else site
        return self._sites[key]

    def view(self, scene: Scene) -> View:
        """The scene's camera, environment and film."""
        asset, scale = scene.environment.asset, scene.environment.scale
        if asset.path not in self._lights:
            self._lights[asset.path] = load_environment(self.file(asset))
        if self._scaled.get(asset.path, (0.0, None))[0] != scale:
            self._scaled[asset.path] = scale, self._lights[asset.path] * scale
        _, radiance = self._scaled[asset.path]
        environment = Environment(radiance, math.radians(scene.environment.rotation_degrees))
        return View(scene.camera.camera(), environment, scene.width, scene.height)

    @property
    def cache(self) -> Path:
        """The folder of what can be made again."""
        return self.folder / _CACHE

    def file(self, asset: AssetRef) -> Path:
        """The asset's path, after a check of its content hash.

        Raises:
            AssetError: the file is missing or has changed.
        """
        path = self.folder / asset.path
        if not path.is_file():
            raise AssetError(f"{path} is missing; the scene cannot be rendered without it.")
        if asset.sha256 is not None and hashlib.sha256(path.read_bytes()).hexdigest() != asset.sha256:
            raise AssetError(f"{path} is not the file that the scene was made with: its content hash differs.")
        return path

    def forget(self) -> None:
        """Drops subjects and layers from memory; environments and models stay."""
        for kept in (self._subjects, self._surfaces, self._maps, self._sites, self._layers, self._wholes):
            kept.clear()

    def _generator(self, asset: AssetRef) -> Generator:
        """A stored generator, on the GPU if there is one: on a CPU, large layers take seconds."""
        if asset.path not in self._generators:
            generator, _ = load_generator(self.file(asset))
            self._generators[asset.path] = generator.cuda() if torch.cuda.is_available() else generator
        return self._generators[asset.path]

    def _whole_surface(self, scene: Scene) -> Surface:
        """The surface of the whole map that a window is cut from. It is kept: all its windows share its arrays."""
        whole = _whole(scene)
        key = subject_key(whole)
        if key not in self._surfaces:
            surface = self.subject(whole).surface
            # since what was read of a file holds all of it in memory
            copies: Any = {name: value.copy() for name, value in vars(surface).items() if isinstance(value, ndarray)}
            self._surfaces[key] = replace(surface, **copies)
        return self._surfaces[key]

    def _make_subject(self, scene: Scene) -> Subject:
        mesh = load_mesh(self.file(scene.mesh))
        if scene.window is not None:
            return self._make_window(scene, scene.window, mesh)
        embedding = load_embedding(scene.embedding.name, scene.embedding.options)
        try:
            return make_subject(mesh, embedding, scene.texture, scene.learnable, file_maps=bool(scene.maps))
        except (AssetError, EmbeddingError) as error:
            raise type(error)(*(f"{scene.mesh.path}: {line}" for line in error.args)) from error

    def _make_window(self, scene: Scene, size: int, mesh: Mesh) -> Subject:
        """The window that shows most of what the scene's camera sees; as large as the scene's texture at most."""
        whole = self.subject(_whole(scene))
        surface, aspect = self._whole_surface(scene), scene.width / scene.height
        if any(surface.repeat):
            raise AssetError(f"{scene.mesh.path}: textures repeat in its embedding, so that it has no windows.")
        window = find_window(surface, whole.learnable, scene.camera.camera(), aspect, size, scene.texture)
        fragments = Fragments.of(windowed(surface, window, scene.texture), size, size)
        baked = bake_subject(mesh, fragments, scene.learnable, file_maps=bool(scene.maps))
        area = baked.buffer.area * bordered(torch.ones(size, size, RGBA))[..., RGBA - 1]  # no score asks for the border
        return replace(baked, buffer=replace(baked.buffer, area=area))

    def _make_maps(self, scene: Scene) -> MeshMaps:
        subject, known = self.subject(scene), None
        if scene.window is not None:  # a survey of each window would take twice as long as all else
            whole = _whole(scene)
            known = interpolated_survey(subject.buffer, self.subject(whole).surface, self.mesh_maps(whole))
        return bake_mesh_maps(subject.surface, subject.buffer, known)

    def _stored(
        self,
        path: Path,
        scene: Scene,
        load: Callable[[Path, int], Any],
        save: Callable[[Path, Any], None],
        make: Callable[[Scene], Any],
        *,
        baked: bool,
    ) -> Any:
        """What the data set's cache holds, or else the user's, or else what is made; both keep it then."""
        if not self.keep:
            return make(scene)
        if path.is_file():
            return load(path, scene.window or scene.texture)
        shared = in_user_cache(path, scene) if baked else None
        if shared is not None and shared.is_file():
            found = load(shared, scene.texture)
            save(path, found)
            return found
        made = make(scene)
        for place in filter(None, (path, shared)):
            save(place, made)
        return made


def _whole(scene: Scene) -> Scene:
    """The scene with the map in which its window is placed and surveyed."""
    return scene.model_copy(update={"window": None, "texture": min(scene.texture, WHOLE)})


def subject_key(scene: Scene) -> str:
    """A name for the scene's baked surface: equal for scenes that differ only in light, camera or materials.

    What is baked of the mesh's file depends on whether the scene declares maps, and so does the name; that of a window
    depends on the camera, too.
    """
    parts: list[Any] = [scene.mesh, scene.embedding, scene.texture, scene.learnable]
    if scene.maps:
        parts.append("file maps")
    if scene.window is not None:
        parts += [scene.window, scene.camera, scene.width / scene.height]
    return f"{Path(scene.mesh.path).stem}-{_digest(*parts)}"


def make_room(kept: dict[Any, Any]) -> None:
    """Drops the oldest, so that fewer than `KEPT` are held."""
    while len(kept) >= KEPT:
        del kept[next(iter(kept))]


def recipe_of(weathering: SceneWeathering) -> Recipe:
    """The recipe with the amount, the seed and the options of a scene."""
    options = {"amount": weathering.amount, "seed": weathering.seed, **weathering.options}
    return recipe_from_options(weathering.recipe, options)


def _digest(*records: Any) -> str:
    plain = [record.model_dump() if hasattr(record, "model_dump") else record for record in records]
    return hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()[:12]
