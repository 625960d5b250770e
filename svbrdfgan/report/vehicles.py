"""The report's rows of pictures: a scene under each layer, and the layers themselves as textures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.evaluation.evaluate import Evaluated, pictures
from svbrdfgan.evaluation.relight import RelitScene
from svbrdfgan.metrics.flip import display, flip
from svbrdfgan.rendering.compositing import composite
from svbrdfgan.report.pictures import Picture, framed, heat, over_checker, signed_as_color, upright
from svbrdfgan.scene.description import Scene, SceneWeathering


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
    """An exemplar beside renders of its scene under each layer, with the FLIP of each render."""
    exemplars = evaluated.source.exemplars
    truth = display(exemplars.images[index].float(), coverage=exemplars.coverage[index].float())
    layers = evaluated.layers_of(index)
    bare = replace(layers["generated"], values=torch.zeros_like(layers["generated"].values))
    made = pictures(evaluated.source, index, {**layers, "bare": bare})
    floor = f"noise alone {flip(truth, made['truth']):.3f}" if "truth" in made else ""
    titles = {"generated": "Learned", "oracle": "Oracle", "constant": "Best constant", "bare": "Unweathered"}
    coverage = exemplars.coverage[index]
    columns = [Titled("Truth", framed(truth, coverage), floor)]
    for name, title in titles.items():
        if name in made:
            columns.append(Titled(title, framed(made[name], coverage), f"FLIP {flip(truth, made[name]):.3f}"))
    return Vehicle(subject_name(exemplars.scenes[index]), _scene_note(exemplars.scenes[index]), tuple(columns))


def relit(found: RelitScene) -> Vehicle:
    """A vehicle in a light and from a view that training never had: the truth beside each layer, with its FLIP."""
    titles = {"generated": "Learned", "oracle": "Oracle", "constant": "Best constant"}
    flips, made = found.flips(), found.pictures
    columns = [Titled("Truth", framed(made["reference"], found.coverage), f"noise alone {flips['truth']:.3f}")]
    for name, title in titles.items():
        if name in made:
            columns.append(Titled(title, framed(made[name], found.coverage), f"FLIP {flips[name]:.3f}"))
    return Vehicle(subject_name(found.scene), _scene_note(found.scene), tuple(columns))


def close_up(found: RelitScene) -> Vehicle:
    """A small part of a vehicle under each layer."""
    titles = {"reference": "Truth", "generated": "Learned", "oracle": "Oracle"}
    columns = [Titled(title, found.pictures[name]) for name, title in titles.items() if name in found.pictures]
    return Vehicle(subject_name(found.scene), _weathering_note(found.scene), tuple(columns))


def textured(evaluated: Evaluated, index: int, top: float) -> Vehicle:
    """The generator's input, its layer, G0's layer, and the errors, in colours from 0 (black) to `top` (bright)."""
    exemplars, number = evaluated.source.exemplars, int(evaluated.source.exemplars.subject_of[index])
    subject, truth = exemplars.subjects[number], exemplars.layers[index]
    assert truth is not None
    made = evaluated.layers_of(index)["generated"].to("cpu")
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
    made = evaluated.layers_of(index)["generated"].to("cpu")
    seen = torch.stack([evaluated.source.seen(view).cpu() > 0 for view in exemplars.views_of(number)]).any(dim=0)
    scored = seen & subject.learnable_texels & (subject.buffer.area > 0)
    return scored, (composite(base, made) - composite(base, truth)).abs().mean(dim=-1)


def _grey(values: Float[Tensor, "rows cols"]) -> Float[Tensor, "rows cols 3"]:
    return values.clamp(0, 1).unsqueeze(-1).expand(*values.shape, 3)


def _weathering_note(scene: Scene) -> str:
    weathering = scene.weathering
    return f"{weathering.recipe}, amount {weathering.amount:.2f}" if isinstance(weathering, SceneWeathering) else ""


def _scene_note(scene: Scene) -> str:
    camera, light = scene.camera, Path(scene.environment.asset.path).stem
    return f"azimuth {camera.azimuth_degrees:.0f}°, elevation {camera.elevation_degrees:.0f}°, light {light}"
