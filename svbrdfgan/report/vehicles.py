"""The report's rows of pictures: a scene under each layer, and the layers themselves as textures."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.evaluation.evaluated import Evaluated, pictures
from svbrdfgan.evaluation.record import Painter
from svbrdfgan.evaluation.relight import PaintedScene
from svbrdfgan.metrics.flip import display, flip
from svbrdfgan.metrics.recovered import shown_texels
from svbrdfgan.rendering.compositing import composite
from svbrdfgan.report.pictures import Picture, framed, heat, over_checker, signed_as_color, upright
from svbrdfgan.scene.description import Scene, SceneWeathering

_TITLES: Mapping[Painter, str] = MappingProxyType(
    {"generated": "Learned", "oracle": "Oracle", "constant": "Best constant"}
)


@dataclass(frozen=True, eq=False)
class Titled:
    """A picture with a title and a note."""

    title: str
    picture: Picture
    note: str = ""


@dataclass(frozen=True, eq=False)
class Vehicle:
    """One or two rows of pictures of one subject."""

    name: str
    note: str
    pictures: tuple[Titled, ...]


def choose_views(exemplars: Exemplars, limit: int) -> list[int]:
    """A weathered exemplar of each of up to `limit` subjects, evenly spread, chosen regardless of what was learned.

    Picks each subject's view closest to mid-grey as displayed, since most of it is neither black nor white.
    """
    views = [exemplars.views_of(number) for number in range(len(exemplars.subjects))]
    weathered = [list(filter(exemplars.weathered, group)) for group in views]
    groups = [group for group in weathered if group]
    if len(groups) > limit:
        groups = [groups[round(n * (len(groups) - 1) / max(limit - 1, 1))] for n in range(limit)]
    return [min(group, key=lambda view: abs(_brightness(exemplars, view) - 0.5)) for group in groups]


def _brightness(exemplars: Exemplars, index: int) -> float:
    """Mean brightness of the covered part of a picture, as displayed."""
    covered = exemplars.coverage[index].float().sum()
    return float(display(exemplars.images[index].float()).sum() / (3 * covered).clamp(min=1e-6))


def subject_name(scene: Scene) -> str:
    """The mesh's name."""
    return Path(scene.mesh.path).stem


def rendered(evaluated: Evaluated, index: int) -> Vehicle:
    """An exemplar and renders of its scene under each layer, with the FLIP of each render."""
    exemplars, layers = evaluated.source.exemplars, evaluated.layers_of(index)
    coverage = exemplars.coverage[index]
    truth = display(exemplars.images[index].float(), coverage=coverage.float())
    nothing = replace(layers["generated"], values=torch.zeros_like(layers["generated"].values))
    *made, bare = pictures(evaluated.source, index, [*layers.values(), nothing])
    vehicle = compared(PaintedScene(exemplars.scenes[index], coverage, truth, dict(zip(layers, made, strict=True))))
    unweathered = Titled("Unweathered", framed(bare, coverage), f"FLIP {flip(truth, bare):.3f}")
    return replace(vehicle, pictures=(*vehicle.pictures, unweathered))


def compared(found: PaintedScene) -> Vehicle:
    """A scene's reference next to its pictures under each layer, with their FLIP."""
    flips = found.flips()
    columns = [Titled("Truth", framed(found.reference, found.coverage), f"noise alone {flips['truth']:.3f}")]
    for painter, title in _titles(found):
        picture = framed(found.pictures[painter], found.coverage)
        columns.append(Titled(title, picture, f"FLIP {flips[painter]:.3f}"))
    return Vehicle(subject_name(found.scene), scene_note(found.scene), tuple(columns))


def shown(found: PaintedScene) -> Vehicle:
    """A scene of a distribution under the true layer and a draw of each network, with the same amount and recipe."""
    columns = [Titled(title, framed(found.pictures[p], found.coverage)) for p, title in _titles(found, drawn=True)]
    pictures = (Titled("Truth", framed(found.reference, found.coverage)), *columns)
    return Vehicle(subject_name(found.scene), f"{weathering_note(found.scene)}, {scene_note(found.scene)}", pictures)


def close_up(found: PaintedScene) -> Vehicle:
    """A small part of a vehicle under each layer."""
    columns = [Titled(title, found.pictures[painter]) for painter, title in _titles(found)]
    pictures = (Titled("Truth", found.reference), *columns)
    return Vehicle(subject_name(found.scene), weathering_note(found.scene), pictures)


def _titles(found: PaintedScene, drawn: bool = False) -> list[tuple[Painter, str]]:
    """The painters of a scene's pictures; of a distribution, without the constant, which is no draw."""
    known = [(painter, title) for painter, title in _TITLES.items() if painter in found.pictures]
    return [(painter, title) for painter, title in known if not (drawn and painter == "constant")]


def textured(evaluated: Evaluated, index: int, top: float) -> Vehicle:
    """The generator's input, its layer, G0's layer, and the errors, in colours from 0 (black) to `top` (bright)."""
    exemplars, number = evaluated.source.exemplars, int(evaluated.source.exemplars.subject_of[index])
    subject, truth = exemplars.subjects[number], exemplars.layers[index]
    assert truth is not None
    made = evaluated.learned(index)
    surface, learnable = subject.buffer.mask, subject.learnable_texels
    scored, error = _error(evaluated, index)
    geometry = subject.geometry.cpu().float()
    mean = float((error * scored * subject.buffer.area).sum() / (scored * subject.buffer.area).sum().clamp(min=1e-12))
    return Vehicle(
        subject_name(exemplars.scenes[index]),
        f"{float(scored.sum() / learnable.sum().clamp(min=1)):.0%} of its learnable texels are scored",
        (
            Titled("Position", upright(signed_as_color(geometry[:3]), surface)),
            Titled("Truth: layer of G0", upright(over_checker(truth), learnable)),
            Titled("Learned: layer of the generator", upright(over_checker(made), learnable)),
            Titled("Error of albedo", upright(heat(error, top), scored), f"mean {mean:.3f}"),
            Titled("Normal", upright(signed_as_color(geometry[3:6]), surface)),
            Titled("Truth: alpha", upright(_grey(truth.alpha), learnable)),
            Titled("Learned: alpha", upright(_grey(made.alpha), learnable)),
            Titled("Error of alpha", upright(heat((made.alpha - truth.alpha).abs(), 1.0), scored)),
        ),
    )


def drawn_textures(evaluated: Evaluated, index: int) -> Vehicle:
    """The generator's input, G0's layer of an exemplar, and a draw of the generator with its amount and recipe."""
    exemplars = evaluated.source.exemplars
    subject, truth, made = exemplars.subject(index), exemplars.layers[index], evaluated.learned(index)
    assert truth is not None
    surface, learnable, geometry = subject.buffer.mask, subject.learnable_texels, subject.geometry.cpu().float()
    return Vehicle(
        subject_name(exemplars.scenes[index]),
        weathering_note(exemplars.scenes[index]),
        (
            Titled("Position", upright(signed_as_color(geometry[:3]), surface)),
            Titled("True draw", upright(over_checker(truth), learnable)),
            Titled("Learned draw", upright(over_checker(made), learnable)),
            Titled("Normal", upright(signed_as_color(geometry[3:6]), surface)),
            Titled("True draw: alpha", upright(_grey(truth.alpha), learnable)),
            Titled("Learned draw: alpha", upright(_grey(made.alpha), learnable)),
        ),
    )


def error_scale(evaluated: Evaluated, indices: Sequence[int]) -> float:
    """A round number above nearly all albedo errors of these exemplars: the top of their colour scale."""
    errors = [error[scored] for scored, error in (_error(evaluated, index) for index in indices)]
    found = torch.cat([torch.zeros(0), *errors])
    high = float(torch.quantile(found[:: max(1, len(found) // 100_000)], 0.99)) if len(found) else 0.0
    return max(0.05, math.ceil(high * 20) / 20)


def _error(evaluated: Evaluated, index: int) -> tuple[Tensor, Tensor]:
    """The texels that are scored, and the absolute error of the composited albedo of all texels."""
    exemplars, number = evaluated.source.exemplars, int(evaluated.source.exemplars.subject_of[index])
    subject, truth = exemplars.subjects[number], exemplars.layers[index]
    assert truth is not None
    base = subject.base_albedo(exemplars.scenes[index].materials)
    made = evaluated.learned(index)
    seen = shown_texels(exemplars, evaluated.source.seen, number)
    scored = seen & subject.learnable_texels & (subject.buffer.area > 0)
    return scored, (composite(base, made) - composite(base, truth)).abs().mean(dim=-1)


def _grey(values: Float[Tensor, "rows cols"]) -> Float[Tensor, "rows cols 3"]:
    return values.clamp(0, 1).unsqueeze(-1).expand(*values.shape, 3)


def weathering_note(scene: Scene) -> str:
    weathering = scene.weathering
    return f"{weathering.recipe}, amount {weathering.amount:.2f}" if isinstance(weathering, SceneWeathering) else ""


def scene_note(scene: Scene) -> str:
    camera, light = scene.camera, Path(scene.environment.asset.path).stem
    return f"azimuth {camera.azimuth_degrees:.0f}°, elevation {camera.elevation_degrees:.0f}°, light {light}"
