"""Weathering by a trained generator: one draw of its distribution, on any mesh."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any
from weakref import WeakKeyDictionary

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.asset.painters import Painter
from svbrdfgan.asset.peels import MOST
from svbrdfgan.inference.apply import choose_draw, explain_memory, finer_factor
from svbrdfgan.inference.embedded_peels import EmbeddedPeels
from svbrdfgan.inference.learned_painter import LearnedPainter
from svbrdfgan.inference.peel_layers import paint_peel
from svbrdfgan.inference.workpiece import Workpiece
from svbrdfgan.networks.draw import Draw
from svbrdfgan.plugins.registry import load_embedding
from svbrdfgan.training.run import Model
from svbrdfgan.types import layer_channels
from svbrdfgan.weathering.recipes import RECIPES, Recipe
from svbrdfgan.weathering.substances import Substance, by_substance

_BENEATH = 1024
"""Texels along a side at which peels beneath the outermost are painted at most, or those of the training."""
_COMPUTING = 16  # bytes of each number of a layer, while it is computed
_EMBEDDED_TEXEL = 120  # bytes of `EmbeddedPeels` for each texel of each peel

_EMBEDDED = WeakKeyDictionary[Workpiece, tuple[tuple[object, ...], EmbeddedPeels]]()
"""The peels of workpieces on which models have painted, and for what kind of model."""


@dataclass(frozen=True, eq=False)
class LearnedWeathering:
    """One draw of a trained model.

    Attributes:
        asked: what files say of it: model, seed, amount and recipe as they were asked for.
        resolution: as for `paint`.
        recipe: what its exemplars showed, if that was a procedural recipe: the layer lies on the same substances.
        draft: whether the generator paints the outermost peel alone, which takes a fraction of the time.
    """

    model: Model
    draw: Draw
    asked: Mapping[str, Any]
    resolution: int | None = None
    recipe: type[Recipe] | None = None
    draft: bool = False

    @classmethod
    def of(
        cls,
        model: Model,
        *,
        name: str | None = None,
        seed: int | None = None,
        amount: float | None = None,
        recipe: str | None = None,
        resolution: int | None = None,
    ) -> LearnedWeathering:
        """The draw of these conditions; see `paint`.

        Args:
            name: of the model, for the files.

        Raises:
            ConfigError: the model does not know what is asked for, or cannot paint at that resolution.
        """
        finer_factor(model, resolution)
        asked = {"model": name, "seed": seed, "amount": amount, "recipe": recipe}
        draw = choose_draw(model, seed=seed, amount=amount, recipe=recipe)
        told = {key: value for key, value in asked.items() if value is not None}
        known = model.config.conditions.recipes
        learned = recipe or (known[0] if len(known) == 1 else "")
        return cls(model, draw, told, resolution, RECIPES.get(learned))

    @property
    def clean(self) -> bool:
        return self.draw.opacity == 0.0

    @property
    def settles_on(self) -> Mapping[Substance, float]:
        return self.recipe.settles_on if self.recipe else {}

    def shares(self, workpiece: Workpiece) -> Float[Tensor, " mesh_faces"]:
        """What alpha is multiplied by on each face of the workpiece's mesh: the recipe's thickness on its substance."""
        substance = torch.from_numpy(workpiece.surroundings.substance)
        return by_substance(substance, self.settles_on) if self.settles_on else torch.ones(len(substance))

    @property
    def description(self) -> Mapping[str, Any]:
        return self.asked

    @property
    def peak_bytes(self) -> int:
        """Of its peels and layers, and of one more layer while it is computed in float32."""
        coarse, channels = self.model.geometry_texels, layer_channels(self.model.generator.maps)
        texels = [(factor * coarse) ** 2 for factor in self._factors]
        return channels * (2 * sum(texels) + _COMPUTING * texels[0]) + _EMBEDDED_TEXEL * MOST * coarse**2

    def painter(self, workpiece: Workpiece) -> Painter:
        """The layers on all peels of the workpiece's mesh.

        Raises:
            EmbeddingError: the mesh cannot be embedded.
            ConfigError: there is not enough memory.
        """
        generator = self.model.generator
        with explain_memory(self.resolution):
            embedded = self._embedded(workpiece)
            embedded = embedded.outermost if self.draft else embedded
            layers = [
                paint_peel(self.draw, generator, embedded.surface, embedded.tangents, peel, geometry, factor)
                for peel, geometry, factor in zip(embedded.peels, embedded.inputs, self._factors, strict=False)
            ]
        further = list(generator.maps)
        if "roughness" in further and "metallic" not in further and self.recipe and not self.recipe.metal:
            further.append("metallic")  # dirt on chrome hides the metal
        shares = self.shares(workpiece).numpy()
        return LearnedPainter(workpiece.mesh, embedded, layers, generator.channels, further, shares)

    def _embedded(self, workpiece: Workpiece) -> EmbeddedPeels:
        """What all draws on a workpiece share, kept as long as the workpiece, for the latest kind of model."""
        trained, texels = self.model.config.dataset.embedding, self.model.geometry_texels
        mesh_maps = self.model.generator.mesh_maps
        wanted = (trained.name, dict(trained.options), texels, mesh_maps)
        known, embedded = _EMBEDDED.get(workpiece, (None, None))
        if embedded is None or known != wanted:
            embedding = load_embedding(trained.name, trained.options)
            embedded = EmbeddedPeels.of(workpiece, embedding, texels, mesh_maps)
            _EMBEDDED[workpiece] = (wanted, embedded)
        return embedded

    @property
    def _factors(self) -> list[int]:
        """How much finer than what the generator reads each peel is painted."""
        outermost = finer_factor(self.model, self.resolution)
        least = max(_BENEATH, self.model.config.dataset.texture) // self.model.geometry_texels
        beneath = min(outermost, least)
        return [outermost, *[beneath] * (MOST - 1)]
