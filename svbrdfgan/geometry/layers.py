"""Find faces that lie beneath others at the same UV, and move them to hidden parts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Int
from numpy import ndarray

from svbrdfgan.geometry.rasterize import Fragments
from svbrdfgan.geometry.split import cut_faces, with_parts
from svbrdfgan.geometry.texels import centroid_texels
from svbrdfgan.protocols import UVEmbedding
from svbrdfgan.types import Mesh, Surface
from svbrdfgan.utils.memory import PROGRAM, most_that_fits, require_memory

TOLERANCE = 0.02
"""A face this far beneath the outermost surface still counts as outermost; in bounding-box diagonals."""
_ROUNDS = 2
_WORTH_CUTTING = 8  # texels: faces that cover fewer are not cut
_BAKING = 130 << 20  # bytes of libraries that are loaded for it, and of batches of fragments
_TEXEL = 250  # bytes of a texel: fragments of all layers, and the buffers that are baked of them


def embed_and_rasterize(embedding: UVEmbedding, mesh: Mesh, resolution: int) -> Fragments:
    """The fragments of the embedded mesh. If the embedding is not one-to-one, inner layers are in hidden parts.

    Raises:
        EmbeddingError: the mesh cannot be embedded.
        ConfigError: that many texels need more memory than may be taken.
    """
    require_memory(
        f"a surface of {resolution} x {resolution} texels needs",
        surface_bytes(resolution),
        lambda allowed: _side(most_that_fits(surface_bytes, resolution, allowed, 16)),
    )
    surface = embedding.embed(mesh)
    if embedding.capabilities.injective:
        return Fragments.of(surface, resolution, resolution)
    return hide_and_rasterize(surface, resolution)


def surface_bytes(resolution: int) -> int:
    """What the process holds at most while it rasterises and bakes a surface at resolution x resolution texels.

    Measured as the peak of processes that bake vehicles of two layers a texel at 1,024 and 2,048 texels a side.
    """
    return PROGRAM + _BAKING + _TEXEL * resolution**2


def _side(texels: int | None) -> str | None:
    return None if texels is None else f"{texels} x {texels}"


def hide_inner_layers(surface: Surface, resolution: int) -> Surface:
    """The surface with its inner faces moved to hidden parts, which are appended to the mesh's own parts.

    A face is hidden if another face lies further out by more than `TOLERANCE` at most of the texel centres that it
    covers (at its centroid, if it covers none). The tolerance keeps surfaces behind trim, attached lights and
    duplicated faces exposed; they share the texels of the face above. Larger, partly covered faces are first cut, at
    most twice.
    """
    return hide_and_rasterize(surface, resolution).surface


def hide_and_rasterize(surface: Surface, resolution: int) -> Fragments:
    """The same as `hide_inner_layers`, but returns the fragments; their `surface` has the hidden parts."""
    fragments = Fragments.of(surface, resolution, resolution)
    covered, near = layer_counts(fragments)
    for _ in range(_ROUNDS):
        # between a tenth and nine tenths of the face is outermost
        mixed = (covered >= _WORTH_CUTTING) & (10 * near > covered) & (10 * near < 9 * covered)
        if not mixed.any():
            break
        fragments = Fragments.of(cut_faces(fragments.surface, mixed), resolution, resolution)
        covered, near = layer_counts(fragments)
    return fragments.with_parts_of(_move_to_hidden(fragments.surface, 2 * near < covered))


def layer_counts(fragments: Fragments) -> tuple[Int[ndarray, " faces"], Int[ndarray, " faces"]]:
    """The number of texels that each face covers, and the number of those where the face is (nearly) the outermost.

    A face that covers no texel's centre counts as covering one texel: that of its centroid.
    """
    surface = fragments.surface
    box = surface.positions[surface.faces].reshape(-1, 3)
    tolerance = TOLERANCE * float(np.linalg.norm(box.max(axis=0) - box.min(axis=0)))
    floor = fragments.top - tolerance
    covered = fragments.texels_of_faces.copy()
    near = np.bincount(fragments.face[fragments.elevation >= floor[fragments.texel]], minlength=len(covered))
    small = np.flatnonzero(covered == 0)
    texel = centroid_texels(surface, fragments.rows, fragments.cols)[small]
    near[small] = surface.elevation[surface.faces[small]].mean(axis=1) >= floor[texel]
    covered[small] = 1
    return covered, near


def _move_to_hidden(surface: Surface, hidden: Bool[ndarray, " faces"]) -> Surface:
    """The surface with the marked faces moved to a hidden twin of their part. Vertices are not shared across parts."""
    part = surface.face_part
    moved = [k for k in np.unique(part[hidden]) if not surface.parts[k].hidden]
    if not moved:
        return surface
    target = np.arange(len(surface.parts))
    target[moved] = len(surface.parts) + np.arange(len(moved))
    whole = [surface.parts[k] for k in moved]
    twins = tuple(replace(part, name=f"{part.name} (hidden)", hidden_half_of=part.name) for part in whole)
    return with_parts(surface, np.where(hidden, target[part], part), surface.parts + twins)
