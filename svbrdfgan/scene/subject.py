"""The asset that pictures show: a mesh's embedded surface, its geometry buffer, and the parts that carry the layer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from svbrdfgan.config.choices import PartSelection
from svbrdfgan.errors import AssetError
from svbrdfgan.geometry.bake import GeometryBuffer, bake, bake_base_color
from svbrdfgan.geometry.layers import embed_and_rasterize
from svbrdfgan.protocols import UVEmbedding
from svbrdfgan.rendering.compositing import composite, composite_maps
from svbrdfgan.types import Material, Materials, Mesh, Surface
from svbrdfgan.types.material import CHANNELS


@dataclass(frozen=True, eq=False)
class Subject:
    """A surface ready to be weathered, learned from and rendered.

    Attributes:
        surface: the embedded mesh, with inner layers hidden.
        buffer: position and normal of each texel, baked from the surface.
        learnable: indices of the parts that carry the layer.
        base: linear RGB reflectance of every part, constant (3,) or (rows, cols, 3) over the surface's UV.
    """

    surface: Surface
    buffer: GeometryBuffer
    learnable: tuple[int, ...]
    base: tuple[Float[Tensor, ...], ...]

    @cached_property
    def geometry(self) -> Float[Tensor, "6 rows cols"]:
        """The generator's input."""
        return self.buffer.network_input()

    @cached_property
    def learnable_texels(self) -> Bool[Tensor, "rows cols"]:
        """Texels whose outermost surface belongs to a learnable part."""
        return torch.isin(self.buffer.part, torch.tensor(self.learnable, dtype=self.buffer.part.dtype))

    def overlooked(self) -> list[str]:
        """A warning for each part that its name keeps clean, but that is larger than all learnable parts."""
        areas = torch.zeros(len(self.surface.parts), dtype=self.buffer.area.dtype)
        areas.index_add_(0, self.buffer.part[self.buffer.mask].long(), self.buffer.area[self.buffer.mask])
        carrying, total = areas[list(self.learnable)].sum(), areas.sum().clamp(min=1e-30)
        return [
            f"{part.name} is {float(area / total):.0%} of the surface and its name keeps it clean: see learnable"
            for number, (part, area) in enumerate(zip(self.surface.parts, areas, strict=True))
            if area > carrying
            and not part.hidden
            and not PartSelection().selects(part)
            and number not in self.learnable
        ]

    def base_colors(self, override: Mapping[str, tuple[float, float, float]]) -> tuple[Float[Tensor, ...], ...]:
        """The base colour of every part. `override` replaces those of the parts it names and of their hidden halves."""
        replaced = {f"{name} (hidden)": color for name, color in override.items()} | dict(override)
        return tuple(
            torch.tensor(replaced[part.name]) if part.name in replaced else base
            for part, base in zip(self.surface.parts, self.base, strict=True)
        )

    def materials(
        self,
        override: Mapping[str, tuple[float, float, float]],
        layer: Float[Tensor, "rows cols channels"] | None,
        maps: Mapping[str, float] | None = None,
    ) -> Materials:
        """Materials of all parts, with the layer over the learnable ones, on its device.

        Args:
            maps: the further maps that the layer paints, and their values under it, on learnable parts and on their
                hidden halves. Other parts stay Lambertian.

        Raises:
            AssetError: the layer has channels for other maps.
        """
        device = None if layer is None else layer.device
        further = {name: torch.full((CHANNELS[name],), float(v), device=device) for name, v in (maps or {}).items()}
        names = [self.surface.parts[part].name for part in self.learnable]
        own = {*names, *(f"{name} (hidden)" for name in names)}
        made = []
        for part, color in enumerate(self.base_colors(override)):
            base = {"base_color": color.to(device)}
            if self.surface.parts[part].name in own:
                base |= further
            if layer is not None and part in self.learnable:
                base = composite_maps(base, layer)
            made.append(Material(base))
        return Materials(tuple(made))

    def albedo(
        self, override: Mapping[str, tuple[float, float, float]], layer: Float[Tensor, "rows cols channels"]
    ) -> Float[Tensor, "rows cols 3"]:
        """Base colour of each texel's own part under the layer. Scores compare this."""
        return composite(self.base_albedo(override), layer)

    def base_albedo(self, override: Mapping[str, tuple[float, float, float]]) -> Float[Tensor, "rows cols 3"]:
        """Base colour of each texel's own part."""
        rows, cols = self.buffer.part.shape
        albedo = torch.zeros(rows, cols, 3)
        for part, color in enumerate(self.base_colors(override)):
            mine = self.buffer.part == part
            albedo[mine] = color.expand(rows, cols, 3)[mine]
        return albedo


def make_subject(mesh: Mesh, embedding: UVEmbedding, resolution: int, selection: PartSelection) -> Subject:
    """Embeds a mesh, hides its inner layers, and bakes its geometry buffer at resolution x resolution texels.

    Raises:
        EmbeddingError: the mesh cannot be embedded.
        AssetError: no part that the selection marks learnable can be seen.
    """
    fragments = embed_and_rasterize(embedding, mesh, resolution)
    surface, buffer = fragments.surface, bake(fragments)
    learnable = tuple(i for i, part in enumerate(surface.parts) if selection.selects(part))
    seen = set(buffer.part.unique().tolist())
    if not seen & set(learnable):
        names = ", ".join(part.name for part in mesh.parts)
        raise AssetError(
            f"no visible part is learnable: the mesh has {names}; include {list(selection.include)}, "
            f"exclude {list(selection.exclude)}. Change 'learnable' (--learnable) so that it selects one."
        )
    return Subject(surface, buffer, learnable, bake_base_color(mesh, fragments))
