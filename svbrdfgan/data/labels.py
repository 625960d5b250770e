"""Labels of an exemplar's pixels, for those who train detectors: what is weathered, parts, depth and normals.

They are computed from the surface, not rendered, so that they are free of noise and the same with every renderer.
`docs/conventions.md` says what each holds.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray
from torch import Tensor

from svbrdfgan.data.config import Label
from svbrdfgan.geometry.camera_hits import CameraHits, camera_hits
from svbrdfgan.geometry.texels import sample_texture
from svbrdfgan.io.exr import save_exr
from svbrdfgan.io.image import save_codes
from svbrdfgan.scene.description import Scene
from svbrdfgan.scene.loader import SceneLoader
from svbrdfgan.types import Layer, Surface

_POINTS = 3
"""Points along a side of a pixel at which the layer's alpha is looked up. Odd, so that one is the pixel's centre."""
_AT_ONCE = 1 << 21
"""The most points at once: their hits take some hundred bytes each."""
_WEATHERED = "weathered"
_PART = "part.id"


def make_labels(
    loader: SceneLoader, scene: Scene, wanted: Collection[Label], ids: Mapping[int, str]
) -> dict[str, Float[Tensor, "height width"]]:
    """The channels of the wanted labels: `weathered`, `part.id`, `depth.Z`, and `normal.X`, `normal.Y`, `normal.Z`.

    All are 0 where nothing is seen. `weathered` is a mean over the pixel; the others are those at its centre.

    Args:
        ids: names of the parts by their ids, which count from 1.
    """
    points = _POINTS if "weathered" in wanted else 1
    step = max(1, _AT_ONCE // (points * points * scene.width))
    bands = [range(row, min(row + step, scene.height)) for row in range(0, scene.height, step)]
    found = [_labels_of(loader, scene, wanted, ids, points, band) for band in bands]
    joined = {name: np.concatenate([channels[name] for channels in found]) for name in found[0]}
    return {name: torch.from_numpy(values.astype(np.float32)) for name, values in joined.items()}


def _labels_of(
    loader: SceneLoader, scene: Scene, wanted: Collection[Label], ids: Mapping[int, str], points: int, band: range
) -> dict[str, Float[ndarray, "rows width"]]:
    """The channels in a band of rows, from `points` x `points` points of each pixel."""
    subject, layer = loader.subject(scene), loader.layer(scene)
    hits = camera_hits(subject.surface, scene.camera.camera(), scene.width, scene.height, points, band)
    centres = hits.centres(points)
    channels: dict[str, ndarray] = {}
    if "weathered" in wanted:
        alpha = np.zeros(hits.face.shape) if layer is None else _alpha_seen(hits, subject.learnable, layer)
        channels[_WEATHERED] = alpha.reshape(len(band), points, scene.width, points).mean(axis=(1, 3))
    if "parts" in wanted:
        channels[_PART] = _ids(subject.surface, ids)[centres.part]
    if "depth" in wanted:
        channels["depth.Z"] = centres.depth
    if "normals" in wanted:
        normal = centres.normals()
        channels |= {f"normal.{axis}": normal[..., number] for number, axis in enumerate("XYZ")}
    return channels


def label_paths(picture: Path, wanted: Collection[Label]) -> list[Path]:
    """The files of the labels next to an exemplar's picture: `NAME.labels.exr`, and what detectors read as PNG."""
    codes = [picture.with_suffix(f".{name}.png") for name in ("weathered", "parts") if name in wanted]
    return [picture.with_suffix(".labels.exr"), *codes] if wanted else []


def save_labels(picture: Path, channels: Mapping[str, Float[Tensor, "height width"]]) -> None:
    """Writes labels next to an exemplar's picture: all as `NAME.labels.exr`, in single precision.

    What detectors read is also written as grey PNG: `NAME.weathered.png`, of 8 bits, where 255 stands for 1; and
    `NAME.parts.png`, of 16 bits, which are the ids.

    Raises:
        AssetError: a file cannot be written there.
    """
    save_exr(picture.with_suffix(".labels.exr"), channels)
    if _WEATHERED in channels:
        save_codes(picture.with_suffix(".weathered.png"), (255.0 * channels[_WEATHERED]).round().int(), 8)
    if _PART in channels:
        save_codes(picture.with_suffix(".parts.png"), channels[_PART].int(), 16)


def _alpha_seen(hits: CameraHits, learnable: Collection[int], layer: Layer) -> Float[ndarray, "rows cols"]:
    """The layer's alpha at each hit of a part that carries it; 0 elsewhere."""
    alpha, carries = np.zeros(hits.face.shape), np.isin(hits.part, list(learnable))
    corners = hits.surface.uv[hits.surface.faces[hits.face[carries]]]
    uv = torch.from_numpy(np.einsum("nj,nji->ni", hits.barycentric[carries], corners))
    alpha[carries] = sample_texture(layer["alpha"], uv, hits.surface.repeat)[:, 0].numpy()
    return alpha


def _ids(surface: Surface, ids: Mapping[int, str]) -> Int[ndarray, " parts_and_none"]:
    """The id of each part of a surface; then 0, which index -1 finds. A hidden half has the id of its part."""
    of_name = {name: number for number, name in ids.items()}
    return np.array([*(of_name[part.mesh_part] for part in surface.parts), 0])
