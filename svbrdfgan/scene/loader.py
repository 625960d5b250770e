"""From scene descriptions to what renderers take: assets loaded, surfaces prepared, each kept for the next scene."""

from __future__ import annotations

import hashlib
import json
import logging
import math
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.config.choices import PluginChoice
from svbrdfgan.errors import AssetError, ConfigError, EmbeddingError
from svbrdfgan.io import load_environment, load_mesh
from svbrdfgan.plugins import load_embedding, load_renderer
from svbrdfgan.plugins.select import choose_renderer
from svbrdfgan.protocols import Renderer
from svbrdfgan.scene.asset import Subject, make_subject
from svbrdfgan.scene.cache import load_layer, load_subject, save_layer, save_subject
from svbrdfgan.scene.description import AssetRef, Scene, SceneWeathering
from svbrdfgan.types import Environment, View
from svbrdfgan.weathering import Recipe, Site, find_site, recipe_from_options, weather

log = logging.getLogger(__name__)

_CACHE = "cache"
_LAYERS = 64
"""Kept in memory, at most."""


def resolve_renderer(
    choice: PluginChoice,
    device: torch.device | None = None,
    maps: Collection[str] = (),
    *,
    differentiable: bool = False,
) -> tuple[Renderer[Any], PluginChoice]:
    """The renderer that a configuration names, `auto` being the best one that works; and the choice, to be recorded.

    What `auto` chose is recorded by name, without the device, so that another machine can render the same.

    Args:
        device: where `auto` is to run; None leaves that to it, too.
        maps: those that layers paint beside base_color.
        differentiable: whether gradients for them are wanted.

    Raises:
        ConfigError: the renderer that is named cannot do that.
        PluginError: it is unknown or does not work here; or, of `auto`, none does.
    """
    if choice.name == "auto":
        kind: Literal["auto", "cpu", "cuda"] = "auto"
        if device is not None:
            kind = "cuda" if device.type == "cuda" else "cpu"
        best = choose_renderer(kind, maps, differentiable=differentiable)
        return load_renderer(best.name, best.options), PluginChoice(name=best.name)
    renderer = load_renderer(choice.name, choice.options)
    require_maps(renderer, maps, differentiable=differentiable)
    return renderer, choice


def require_maps(renderer: Renderer[Any], maps: Collection[str], *, differentiable: bool = False) -> None:
    """Refuses a renderer that does not read these maps, or has no gradients for them where those are wanted.

    Raises:
        ConfigError: names what it lacks.
    """
    able = renderer.capabilities.maps
    if differentiable:
        able = able & renderer.capabilities.differentiable
    lacking = [name for name in maps if name not in able]
    if lacking:
        raise ConfigError(
            f"{type(renderer).__name__} cannot {'learn' if differentiable else 'render'} {', '.join(lacking)}, which "
            "the data set's layers paint: choose a renderer that can (`svbrdfgan backends` shows what each can do)."
        )


@dataclass
class Studio:
    """Everything that scenes of one folder need, made at most once; of layers, the last are at hand.

    Attributes:
        folder: what asset paths are relative to.
        keep: whether subjects and layers are stored there, for the next run.
    """

    folder: Path
    keep: bool = True
    _subjects: dict[str, Subject] = field(default_factory=dict)
    _sites: dict[str, Site] = field(default_factory=dict)
    _layers: dict[str, Float[Tensor, "rows cols channels"]] = field(default_factory=dict)
    _lights: dict[str, Float[Tensor, "rows cols 3"]] = field(default_factory=dict)

    def subject(self, scene: Scene) -> Subject:
        """The scene's surface, embedded and baked."""
        key = subject_key(scene)
        if key not in self._subjects:
            path = self.folder / _CACHE / "subjects" / f"{key}.safetensors"
            self._subjects[key] = self._stored(path, load_subject, save_subject, lambda: self._make_subject(scene))
        return self._subjects[key]

    def layer(self, scene: Scene) -> Float[Tensor, "rows cols channels"] | None:
        """What G0 paints on the scene's surface; None where it is not weathered, or nobody knows how."""
        if not isinstance(scene.weathering, SceneWeathering):
            return None
        key = f"{subject_key(scene)}-{_digest(scene.weathering, *scene.maps)}"
        if key not in self._layers:
            path = self.folder / _CACHE / "layers" / f"{key}.safetensors"
            recipe = _recipe(scene.weathering)
            if len(self._layers) >= _LAYERS:
                del self._layers[next(iter(self._layers))]
            self._layers[key] = self._stored(path, load_layer, save_layer, lambda: self._weather(scene, recipe))
        return self._layers[key]

    def view(self, scene: Scene) -> View:
        """The scene's camera, light and film."""
        asset = scene.environment.asset
        if asset.path not in self._lights:
            self._lights[asset.path] = load_environment(self.file(asset))
        radiance = self._lights[asset.path] * scene.environment.scale
        environment = Environment(radiance, math.radians(scene.environment.rotation_degrees))
        return View(scene.camera.camera(), environment, scene.width, scene.height)

    def file(self, asset: AssetRef) -> Path:
        """The asset's path, after its content has been checked.

        Raises:
            AssetError: it is missing, or not what it was.
        """
        path = self.folder / asset.path
        if not path.is_file():
            raise AssetError(f"{path} is missing; the scene cannot be rendered without it.")
        if asset.sha256 is not None and hashlib.sha256(path.read_bytes()).hexdigest() != asset.sha256:
            raise AssetError(f"{path} is not the file that the scene was made with: its content hash differs.")
        return path

    def forget(self) -> None:
        """Lets go of subjects and layers; environments stay."""
        for kept in (self._subjects, self._sites, self._layers):
            kept.clear()

    def _weather(self, scene: Scene, recipe: Recipe) -> Float[Tensor, "rows cols channels"]:
        """The layers of a surface share what takes most of the time; it is large, so that of one alone is kept."""
        subject, key = self.subject(scene), subject_key(scene)
        if key not in self._sites:
            self._sites.clear()
            self._sites[key] = find_site(subject.surface, subject.buffer)
        return weather(subject.surface, subject.buffer, recipe, scene.maps, site=self._sites[key])

    def _make_subject(self, scene: Scene) -> Subject:
        mesh = load_mesh(self.file(scene.mesh))
        embedding = load_embedding(scene.embedding.name, scene.embedding.options)
        try:
            made = make_subject(mesh, embedding, scene.texture, scene.learnable)
        except (AssetError, EmbeddingError) as error:
            raise type(error)(f"{scene.mesh.path}: {error}") from error
        for told in made.overlooked():
            log.warning("%s: %s", scene.mesh.path, told)
        return made

    def _stored(self, path: Path, load: Callable[..., Any], save: Callable[..., None], make: Callable[[], Any]) -> Any:
        if self.keep and path.is_file():
            return load(path)
        made = make()
        if self.keep:
            save(path, made)
        return made


def subject_key(scene: Scene) -> str:
    """A name for the scene's surface: equal for scenes that differ in light, camera or materials alone."""
    parts = (scene.mesh, scene.embedding, scene.texture, scene.learnable)
    return f"{Path(scene.mesh.path).stem}-{_digest(*parts)}"


def _recipe(weathering: SceneWeathering) -> Recipe:
    options = {"amount": weathering.amount, "seed": weathering.seed, **weathering.options}
    return recipe_from_options(weathering.recipe, options)


def _digest(*records: Any) -> str:
    plain = [record.model_dump() if hasattr(record, "model_dump") else record for record in records]
    return hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()[:12]
