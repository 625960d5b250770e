"""The asset that pictures show: a mesh's embedded surface, its geometry buffer, and the parts that carry the layer."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType

import torch
from jaxtyping import Bool, Float
from numpy import ndarray
from torch import Tensor

from svbrdfgan.config.choices import PartSelection
from svbrdfgan.errors import AssetError
from svbrdfgan.geometry.bake import GeometryBuffer, bake
from svbrdfgan.geometry.bake_materials import bake_base_color, bake_file_maps
from svbrdfgan.geometry.layers import embed_and_rasterize
from svbrdfgan.geometry.rasterize import Fragments
from svbrdfgan.networks.inputs import Inputs, Wholes
from svbrdfgan.protocols import UVEmbedding
from svbrdfgan.rendering.compositing import BARE, bare_maps, composite, composite_maps
from svbrdfgan.types import Layer, Material, Materials, Mesh, Surface
from svbrdfgan.utils.memory import require_memory
from svbrdfgan.weathering.mesh_maps import MeshMaps, bake_mesh_maps

_TEXEL = 16
"""Bytes of one channel of a part's texel while it is baked: 13 to 17 for 30 and 60 parts at 512 texels."""

BaseColors = Mapping[str, tuple[float, float, float]]
"""Linear RGB reflectance by the name of a part."""


@dataclass(frozen=True, eq=False)
class Subject:
    """A surface ready to be weathered, learned from and rendered.

    Attributes:
        surface: the embedded mesh, with inner layers hidden.
        buffer: position and normal of each texel, baked from the surface.
        learnable: indices of the parts that carry the layer.
        base: linear RGB reflectance of every part, constant (3,) or (rows, cols, 3) over the surface's UV.
        file_maps: by name, what the mesh's file says of each part's roughness, metallic and normal, likewise
            (channels,) or (rows, cols, channels). Empty if the subject was made for base colours alone.
        mesh_maps: if the generator reads them.
        wholes: the whole map that it is a window of, if the generator reads that.
    """

    surface: Surface
    buffer: GeometryBuffer
    learnable: tuple[int, ...]
    base: tuple[Float[Tensor, ...], ...]
    file_maps: tuple[Mapping[str, Float[Tensor, ...]], ...] = ()
    mesh_maps: MeshMaps | None = None
    wholes: Wholes | None = None

    @cached_property
    def geometry(self) -> Float[Tensor, "6 rows cols"]:
        """Position and normal, as networks see them."""
        return self.buffer.network_input()

    @cached_property
    def generator_input(self) -> Float[Tensor, "inputs rows cols"]:
        """Position and normal, and then the mesh maps if they were baked."""
        return self.geometry if self.mesh_maps is None else torch.cat([self.geometry, self.mesh_maps.network_input()])

    @property
    def inputs(self) -> Inputs:
        """All that generators read, as a batch of one."""
        return Inputs(self.generator_input.unsqueeze(0), self.wholes)

    def with_mesh_maps(self) -> Subject:
        """The same subject with mesh maps."""
        return replace(self, mesh_maps=bake_mesh_maps(self.surface, self.buffer))

    @cached_property
    def learnable_texels(self) -> Bool[Tensor, "rows cols"]:
        """Texels whose outermost surface belongs to a learnable part."""
        return torch.isin(self.buffer.part, torch.tensor(self.learnable, dtype=self.buffer.part.dtype))

    @cached_property
    def with_hidden_halves(self) -> frozenset[int]:
        """The learnable parts, and what hidden layers were cut off them."""
        own = {self.surface.parts[part].name for part in self.learnable}
        return frozenset(number for number, part in enumerate(self.surface.parts) if part.mesh_part in own)

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

    def base_colors(self, override: BaseColors) -> tuple[Float[Tensor, ...], ...]:
        """The base colour of every part. `override` replaces those of the parts it names and of their hidden halves."""
        return tuple(
            torch.tensor(override[part.mesh_part]) if part.mesh_part in override else base
            for part, base in zip(self.surface.parts, self.base, strict=True)
        )

    def materials(
        self,
        layer: Layer | None = None,
        maps: Mapping[str, float | None] | None = None,
        *,
        base_colors: BaseColors = MappingProxyType({}),
    ) -> Materials:
        """Materials of all parts, with the layer over the learnable ones, on its device.

        Args:
            maps: the further maps that the layer paints, and their values under it, on learnable parts and on their
                hidden halves; None stands for what the mesh's file says, or else `BARE`, and is the default for all of
                the layer's maps. Of these maps, other parts have what the file says; without roughness they are
                Lambertian. With no further maps, all parts are.
            base_colors: by part, replaces the mesh's own.

        Raises:
            AssetError: the layer paints other maps.
        """
        if maps is None:
            maps = {} if layer is None else dict.fromkeys(layer.maps)
        if layer is not None and maps.keys() != set(layer.maps):
            raise AssetError(f"a layer paints {_listed(layer.maps)}; wanted {_listed(maps)}.")
        device, made = None if layer is None else layer.values.device, []
        for part, color in enumerate(self.base_colors(base_colors)):
            further = self._of_file(part, maps)
            if part in self.with_hidden_halves:
                declared = {name: value for name, value in maps.items() if value is not None}
                further = bare_maps({name: BARE[name] for name in maps}) | further | bare_maps(declared)
            base = {name: values.to(device) for name, values in {"base_color": color, **further}.items()}
            if layer is not None and part in self.learnable:
                base = composite_maps(base, layer)
            made.append(Material(base))
        return Materials(tuple(made))

    def _of_file(self, part: int, maps: Collection[str]) -> dict[str, Float[Tensor, ...]]:
        """The maps of a part that its mesh's file gives, of those that are rendered."""
        given = self.file_maps[part] if self.file_maps else {}
        return {name: values for name, values in given.items() if name in maps}

    def albedo(self, layer: Layer, *, base_colors: BaseColors = MappingProxyType({})) -> Float[Tensor, "rows cols 3"]:
        """Base colour of each texel's own part under the layer. Scores compare this."""
        return composite(self.base_albedo(base_colors), layer)

    def base_albedo(self, override: BaseColors) -> Float[Tensor, "rows cols 3"]:
        """Base colour of each texel's own part."""
        rows, cols = self.buffer.part.shape
        albedo = torch.zeros(rows, cols, 3)
        for part, color in enumerate(self.base_colors(override)):
            mine = self.buffer.part == part
            albedo[mine] = color.expand(rows, cols, 3)[mine]
        return albedo


def make_subject(
    mesh: Mesh, embedding: UVEmbedding, resolution: int, selection: PartSelection, *, file_maps: bool = False
) -> Subject:
    """Embeds a mesh, hides its inner layers, and bakes its geometry buffer at resolution x resolution texels.

    Args:
        file_maps: whether roughness, metallic, normal and alpha of the mesh's file are baked, too. Data sets and calls
            that declare maps besides base_color set it. For the others glass stays opaque and all is Lambertian, so
            that pictures, stored light transport and runs of base colour do not change with what else files say.

    Raises:
        EmbeddingError: the mesh cannot be embedded.
        AssetError: no part that the selection marks learnable can be seen, or the parts' own textures need more
            memory than there is.
    """
    subject = bake_subject(mesh, embed_and_rasterize(embedding, mesh, resolution), selection, file_maps=file_maps)
    if not set(subject.buffer.part.unique().tolist()) & set(subject.learnable):
        names = ", ".join(part.name for part in mesh.parts)
        raise AssetError(
            f"no visible part is learnable: the mesh has {names}; include {list(selection.include)}, "
            f"exclude {list(selection.exclude)}. Change 'learnable' (--learnable) so that it selects one."
        )
    return subject


def bake_subject(mesh: Mesh, fragments: Fragments, selection: PartSelection, *, file_maps: bool = False) -> Subject:
    """The subject of a mesh's rasterised surface.

    Args:
        file_maps: as for `make_subject`.

    Raises:
        AssetError: no face covers a texel, or the parts' own textures need more memory than there is.
    """
    _require_memory(mesh, fragments, file_maps=file_maps)
    surface, buffer = fragments.surface, bake(fragments)
    learnable = tuple(i for i, part in enumerate(surface.parts) if selection.selects(part))
    base = bake_base_color(mesh, fragments)
    if not file_maps:
        return Subject(surface, buffer, learnable, base)
    baked = bake_file_maps(mesh, fragments)
    parts = tuple(replace(part, alpha=_alpha(maps)) for part, maps in zip(surface.parts, baked, strict=True))
    further = tuple({name: values for name, values in maps.items() if name != "alpha"} for maps in baked)
    return Subject(replace(surface, parts=parts), buffer, learnable, base, further)


def _require_memory(mesh: Mesh, fragments: Fragments, *, file_maps: bool) -> None:
    """Checks that the textures of all parts, each as large as the surface's, can be held.

    Raises:
        AssetError: they cannot.
    """
    textured, texels = [], fragments.rows * fragments.cols
    for part in fragments.surface.parts:
        maps = part.all_maps.values() if file_maps else [part.all_maps["base_color"]]
        textured.append(sum(len(m.factor) for m in maps if m.texture is not None and mesh.uv_set(m.uv_set) is not None))
    needed = _TEXEL * sum(textured) * texels
    size = f"{fragments.rows} x {fragments.cols} texels"
    require_memory(
        f"{sum(map(bool, textured))} parts with textures of their own at {size} need",
        needed,
        lambda allowed: f"about {math.isqrt(texels * allowed // needed)} texels along a side",
        error=AssetError,
    )


def _listed(maps: Iterable[str]) -> str:
    return ", ".join(("base_color", *maps))


def _alpha(maps: Mapping[str, Float[Tensor, ...]]) -> float | Float[ndarray, "rows cols"]:
    """A part's alpha as renderers take it: a number wherever one will do, since opaque parts are traced faster."""
    alpha = maps.get("alpha", torch.ones(1)).clamp(0.0, 1.0)
    return alpha[..., 0].numpy() if alpha.ndim == 3 and alpha.min() < alpha.max() else float(alpha.flatten()[0])
