"""Close-ups: a small part of a vehicle under the true layer and the learned ones, near enough to see texels."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.evaluation.record import Painter
from svbrdfgan.evaluation.relight import PaintedScene, Setting, evenly
from svbrdfgan.geometry.camera_hits import camera_hits
from svbrdfgan.rendering.checked_renderer import CheckedRenderer
from svbrdfgan.scene.description import SceneWeathering
from svbrdfgan.scene.subject import Subject
from svbrdfgan.types import Camera, Layer, View

_COUNT = 3  # vehicles, at most
_ZOOM = 4.0  # the field of view is divided by it


def close_ups(
    exemplars: Exemplars,
    renderer: CheckedRenderer,
    layers_of: Callable[[int], Mapping[Painter, Layer]],
) -> tuple[PaintedScene, ...]:
    """Close-ups of up to three vehicles: the middle of the exemplar with the greatest amount, four times nearer.

    The vehicles are evenly spread over the split, and chosen regardless of what was learned.

    Args:
        layers_of: an exemplar's layers, the true one among them.
    """
    weathered = [list(filter(exemplars.weathered, exemplars.views_of(n))) for n in range(len(exemplars.subjects))]
    chosen = [max(views, key=lambda view: _amount(exemplars, view)) for views in weathered if views]
    found = []
    for exemplar in (chosen[n] for n in evenly(len(chosen), _COUNT)):
        scene, subject = exemplars.scenes[exemplar], exemplars.subject(exemplar)
        view = _nearer(subject, exemplars.loader.view(scene))
        layers: dict[Painter, Layer] = {by: layer for by, layer in layers_of(exemplar).items() if by != "constant"}
        found.append(Setting(scene, view, subject, renderer, renderer.prepare(subject.surface)).painted(layers))
    return tuple(found)


def _amount(exemplars: Exemplars, exemplar: int) -> float:
    weathering = exemplars.scenes[exemplar].weathering
    assert isinstance(weathering, SceneWeathering)
    return weathering.amount


def _nearer(subject: Subject, view: View) -> View:
    """The view of the learnable point in the picture that is nearest to the middle of all of them; as many pixels."""
    hits = camera_hits(subject.surface, view.camera, view.width, view.height)
    rows, cols = np.nonzero(np.isin(hits.part, subject.learnable))
    if not len(rows):
        return view
    nearest = np.argmin((rows - rows.mean()) ** 2 + (cols - cols.mean()) ** 2)
    x, y, z = hits.interpolate(subject.surface.positions)[rows[nearest], cols[nearest]].tolist()
    old = view.camera
    camera = Camera(old.origin, (x, y, z), old.up, old.vertical_fov / _ZOOM)
    side = max(8, round((view.width * view.height) ** 0.5))
    return replace(view, camera=camera, width=side, height=side)
