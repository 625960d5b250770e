"""Whether an asset's own UVs can hold a layer: each texel must show one place of the surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from svbrdfgan.asset.islands import areas, find_islands, signed_areas, uv_islands, welded
from svbrdfgan.asset.shared_texels import texel_use

ALLOWED = 2e-3
"""The greatest share of the area that may be affected."""
_BEYOND = 1e-3  # of a tile: how far UVs may pass its border; exporters round, and a texel is as wide
_COARSE = 400.0  # islands with this many times fewer texels than their share of the area are palette entries


_FRAGMENTS = 600_000  # pairs of face and texel that are looked at: what repeats a hundredfold gets a coarser raster
_FRAGMENTS_A_FACE = 4096  # likewise, of few faces: 2,000 materials of a dozen faces are judged in seconds


@dataclass(frozen=True)
class UVFitness:
    """How well a UV map can hold a layer. All shares are of the area in space, in [0, 1].

    Attributes:
        fits: whether at most `ALLOWED` of the area is affected by each flaw.
        reason: the worst flaw, in a clause for the user; empty if the UVs fit.
        overlap: share whose texels show a second place, too.
        degenerate: share of faces that are a line or a point in UV, in islands that are not.
        tiling: share of faces that cross a tile's border or span more than a tile.
        palette: share of islands so small in UV that a whole part is one colour.
    """

    fits: bool
    reason: str
    overlap: float = 0.0
    degenerate: float = 0.0
    tiling: float = 0.0
    palette: float = 0.0


def uv_fitness(
    positions: Float[ndarray, "faces 3 3"],
    uv: Float[ndarray, "faces 3 2"] | None,
    size: tuple[int, int] = (1024, 1024),
) -> UVFitness:
    """A judgement of one material's UVs, over all its faces in world space, for a texture of `size` (cols, rows)."""
    if uv is None:
        return UVFitness(False, "no UVs")
    area = areas(positions)
    total = area.sum()
    if total <= 0.0:
        return UVFitness(True, "")
    moved = _into_tile(uv)
    found = {flaw: float(area[faces].sum() / total) for flaw, faces in _flaws(area, uv, positions).items()}
    found["tiling"] = float(area[_leaves(moved)].sum() / total)
    found["overlap"] = _overlap(positions, moved, area, size)
    return UVFitness(max(found.values()) <= ALLOWED, _reason(found), **found)


def wrapped(uv: Float[ndarray, "faces 3 2"]) -> Float[ndarray, "faces 3 2"]:
    """The UVs moved by whole tiles into [0, 1].

    An island moves as one if it fits into a tile, else each of its faces by itself. Faces that cross a tile's border
    stay outside.
    """
    moved = _into_tile(uv)
    return np.where(_leaves(moved)[:, None, None], moved, np.clip(moved, 0.0, 1.0))


def _into_tile(uv: Float[ndarray, "faces 3 2"]) -> Float[ndarray, "faces 3 2"]:
    places = welded(uv)
    island = find_islands(places, places, np.zeros(len(uv), dtype=np.int64))
    count = int(island.max(initial=-1)) + 1
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    np.minimum.at(low, island, uv.min(axis=1))
    np.maximum.at(high, island, uv.max(axis=1))
    whole = np.floor((low + high) / 2.0)
    fits = ((low - whole >= -_BEYOND) & (high - whole <= 1.0 + _BEYOND)).all(axis=1)[island, None]
    each = np.floor((uv.min(axis=1) + uv.max(axis=1)) / 2.0)
    return uv - np.where(fits, whole[island], each)[:, None]


def _leaves(uv: Float[ndarray, "faces 3 2"]) -> Bool[ndarray, " faces"]:
    return (uv.min(axis=(1, 2)) < -_BEYOND) | (uv.max(axis=(1, 2)) > 1.0 + _BEYOND)


def _flaws(
    area: Float[ndarray, " faces"],
    uv: Float[ndarray, "faces 3 2"],
    positions: Float[ndarray, "faces 3 3"],
) -> dict[str, Bool[ndarray, " faces"]]:
    """Degenerate faces and those of a palette: where these are most of the surface, both are a palette."""
    island = uv_islands(positions, uv)
    flat = signed_areas(uv) == 0.0
    held = np.bincount(island, np.abs(signed_areas(uv)))[island]
    coarse = held * _COARSE < np.bincount(island, area)[island] / area.sum()
    if area[flat | coarse].sum() > area.sum() / 2.0:
        return {"palette": flat | coarse, "degenerate": np.zeros(len(area), dtype=bool)}
    return {"palette": coarse & ~flat, "degenerate": flat}


def _overlap(
    positions: Float[ndarray, "faces 3 3"],
    uv: Float[ndarray, "faces 3 2"],
    area: Float[ndarray, " faces"],
    size: tuple[int, int],
) -> float:
    """Share of the area that has texels. Faces between texel centres say nothing."""
    most = min(_FRAGMENTS, _FRAGMENTS_A_FACE * len(uv))
    finer = np.sqrt(most / max(np.abs(signed_areas(uv)).sum() * size[0] * size[1], 1e-300))
    cols, rows = (max(1, round(side * min(1.0, finer))) for side in size)
    use = texel_use(positions, uv, rows, cols)
    seen = np.bincount(use.face, minlength=len(area)) > 0
    return float((area * use.doubled_share(len(area))).sum() / max(area[seen].sum(), 1e-300))


def _reason(found: dict[str, float]) -> str:
    worst = max(found, key=lambda flaw: found[flaw])
    if found[worst] <= ALLOWED:
        return ""
    clause = {
        "overlap": "islands overlap",
        "degenerate": "faces have no area in UV",
        "tiling": "the texture repeats",
        "palette": "whole parts share a few texels, as in a palette",
    }[worst]
    percent = 100.0 * found[worst]
    return f"{clause} ({percent:.{0 if percent >= 1.0 else 1}f} % of the area)"
