"""Measure embeddings on a folder of meshes: a summary per mesh, and the similarity of maps of different meshes."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from svbrdfgan.errors import AssetError
from svbrdfgan.geometry.layers import hide_inner_layers
from svbrdfgan.io.mesh import SUFFIXES, load_mesh
from svbrdfgan.metrics.uv.neighbours import Similarity, similarity
from svbrdfgan.metrics.uv.summary import UVSummary
from svbrdfgan.metrics.uv.visibility import VisibleSurface, visible_surface
from svbrdfgan.protocols import UVEmbedding

log = logging.getLogger(__name__)

PARTNERS = 2  # number of meshes that each mesh is compared with, if there are too many pairs
_FACTS = frozenset({"seen", "area"})  # properties of the mesh, not of the embedding: left out of summaries
HIGHER_IS_BETTER = frozenset({"coverage", "connectivity", "kept", "matched"})

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Measured:
    """The results of one embedding.

    Attributes:
        summaries: by name of the mesh, without failed ones.
        seconds: time that the embedding took, by name of the mesh, without failed ones.
        failures: reason of each failure, by name of the mesh.
        similarities: by the names of both meshes.
    """

    summaries: Mapping[str, UVSummary]
    seconds: Mapping[str, float]
    failures: Mapping[str, str]
    similarities: Mapping[tuple[str, str], Similarity]

    def values(self) -> dict[str, dict[str, float]]:
        """The values by name of the measure, then by mesh or pair of meshes."""
        found: dict[str, dict[str, float]] = {}
        for mesh, summary in self.summaries.items():
            for name, value in {**summary.flat(), "seconds": self.seconds[mesh]}.items():
                found.setdefault(name, {})[mesh] = value
        for pair, alike in self.similarities.items():
            for name, value in (("similarity", alike.mean), ("matched", alike.matched)):
                found.setdefault(name, {})[" / ".join(pair)] = value
        return found

    def summary(self) -> dict[str, dict[str, Any]]:
        """Median and worst value of each measure, and the mesh or pair ("of") with the worst. NaNs are ignored."""
        made = {}
        for name, by_mesh in self.values().items():
            known = {mesh: value for mesh, value in by_mesh.items() if not math.isnan(value)}
            if known and name not in _FACTS:
                pick = min if name in HIGHER_IS_BETTER else max
                mesh = pick(known, key=lambda mesh: known[mesh])
                made[name] = {"median": float(np.median(list(known.values()))), "worst": known[mesh], "of": mesh}
        return made


def mesh_files(folder: Path) -> dict[str, Path]:
    """The meshes in a folder, by name, sorted.

    Raises:
        AssetError: it is not a folder, or contains no meshes.
    """
    files = sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES) if folder.is_dir() else []
    if not files:
        raise AssetError(f"{folder} holds no mesh; wanted a folder of {', '.join(SUFFIXES)} files.")
    return {path.name: path for path in files}


def sample_pairs(names: Sequence[str]) -> list[tuple[str, str]]:
    """Pairs of names: all if there are few, otherwise each name with the next `PARTNERS` names in a shuffled ring.

    The shuffle has a fixed seed. Without it, files with similar names, which often show similar vehicles, would be
    compared more often than others.
    """
    every = [(one, other) for i, one in enumerate(names) for other in names[i + 1 :]]
    if len(every) <= PARTNERS * len(names):
        return every
    ring = [names[i] for i in np.random.default_rng(0).permutation(len(names))]
    return [(one, ring[(i + step) % len(ring)]) for step in range(1, PARTNERS + 1) for i, one in enumerate(ring)]


def measure_embedding(
    embedding: UVEmbedding, meshes: Mapping[str, Path], resolution: int, progress: Progress
) -> Measured:
    """The results of an embedding on all meshes. Failures are recorded. `progress` gets each mesh's or pair's name."""
    found: dict[str, VisibleSurface] = {}
    summaries: dict[str, UVSummary] = {}
    seconds: dict[str, float] = {}
    failures: dict[str, str] = {}
    for name, path in meshes.items():
        progress(name)
        try:
            found[name], seconds[name] = _embed(embedding, path, resolution)
            summaries[name] = UVSummary.of(found[name])
        except Exception as error:  # a plugin may raise anything; the other meshes are still measured
            failures[name] = str(error) or type(error).__name__
            log.info("%s: %s", name, failures[name])
    pairs = sample_pairs([name for name in summaries if len(found[name].faces)])
    alike = {}
    for pair in pairs:
        progress(" / ".join(pair))
        alike[pair] = similarity(found[pair[0]], found[pair[1]])
    return Measured(summaries, {name: seconds[name] for name in summaries}, failures, alike)


def _embed(embedding: UVEmbedding, path: Path, resolution: int) -> tuple[VisibleSurface, float]:
    """The visible surface of the embedded mesh, and the seconds that `embed` took."""
    mesh = load_mesh(path)
    start = time.perf_counter()
    surface = embedding.embed(mesh)
    seconds = time.perf_counter() - start
    if not embedding.capabilities.injective:
        surface = hide_inner_layers(surface, resolution)
    return visible_surface(surface), seconds


def as_json(results: Mapping[str, Measured]) -> dict[str, Any]:
    """The results as JSON values: summary, failures, meshes and pairs of each embedding; non-finite values are None."""
    return {
        name: {
            "summary": {
                key: {"median": _finite(row["median"]), "worst": _finite(row["worst"]), "of": row["of"]}
                for key, row in measured.summary().items()
            },
            "failures": dict(measured.failures),
            "meshes": {
                mesh: {key: _finite(value) for key, value in summary.flat().items()}
                | {"seconds": measured.seconds[mesh]}
                for mesh, summary in measured.summaries.items()
            },
            "similarity": [
                {"meshes": list(pair), **{key: _finite(value) for key, value in vars(alike).items()}}
                for pair, alike in measured.similarities.items()
            ],
        }
        for name, measured in results.items()
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
