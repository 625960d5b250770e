"""Layers finer than a model was trained: `Generator.forward(factor=...)` and other ways, on procedural vehicles.

    python benchmarks/finer_layers.py runs/cars --factor 4                 # a power of two
    python benchmarks/finer_layers.py runs/cars --factor 4 --recipe smooth-rust   # for a model of several recipes

- `ours`: only the last convolution runs at the finer resolution.
- `interpolated`: the layer of the trained resolution, bilinear.
- `plain`: the generator runs on the finer geometry buffer.
- `phases`: dilated convolutions, which paint each shift by a part of a texel apart.
- `blended`: four neighbouring phases at each texel, with the weights of linear interpolation.

Columns are means over three vehicles; of alpha, on the learnable surface:

- `shared`: power in the four finest octaves that both layers have, finer / trained.
- `finer`: power in the octaves beyond, finest first, relative to the finest octave of the trained layer.
- `grid`: power at a period of one trained texel, relative to that at slightly shorter and longer periods; 1 is no grid.
- `edge`: 99th percentile of the difference of neighbouring texels, in units per trained texel.
- `mean`, `p99`: of the absolute difference of the box-filtered finer layer from the trained one.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import click
import torch
import torch.nn.functional as F
from torch import Tensor

from svbrdfgan.inference.apply import choose_draw, prepare
from svbrdfgan.metrics.texture_pyramid import octaves, premultiplied
from svbrdfgan.networks.draw import Draw
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.vehicle import build_vehicle
from svbrdfgan.scene.subject import Subject
from svbrdfgan.training.run import Model, load_model
from svbrdfgan.types import Layer, layer_channels

VEHICLES = (("sedan", 9), ("van", 5), ("pickup", 4))


@click.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.option("--factor", default=4, show_default=True)
@click.option("--seed", type=int)
@click.option("--amount", type=float)
@click.option("--recipe")
def main(run: Path, factor: int, seed: int | None, amount: float | None, recipe: str | None) -> None:
    model = load_model(run)
    draw = choose_draw(model, seed=seed, amount=amount, recipe=recipe)
    with torch.no_grad():
        measured = [measure(model, draw, factor, *vehicle) for vehicle in VEHICLES]
    for way in measured[0]:
        mean = {name: torch.stack([found[way][name] for found in measured]).mean(dim=0) for name in measured[0][way]}
        click.echo(f"{way:12}  " + "  ".join(f"{name} {words(values)}" for name, values in mean.items()))


def words(values: Tensor) -> str:
    return " ".join(f"{value:.3f}" for value in values.flatten().tolist())


def measure(model: Model, draw: Draw, factor: int, kind: str, seed: int) -> dict[str, dict[str, Tensor]]:
    """The columns of each way on one vehicle."""
    mesh, size = build_vehicle(sample_vehicle(kind, seed)), model.config.dataset.texture
    trained, finer = (prepare(mesh, model, resolution=resolution) for resolution in (size, size * factor))
    coarse, fine = trained.paint(draw), finer.subject.geometry[None]
    stack = coarse.values.permute(2, 0, 1)[None]
    ways = {
        "ours": finer.paint(draw).values,
        "interpolated": F.interpolate(stack, scale_factor=factor, mode="bilinear")[0].permute(1, 2, 0),
        "plain": draw(fine)[0],
        "phases": phases(draw, fine, factor, 0.5),
        "blended": phases(draw, fine, factor, 1.0),
    }
    layers = {name: Layer(values, coarse.maps) for name, values in ways.items()}
    return {name: columns(finer.subject, layer, trained.subject, coarse, factor) for name, layer in layers.items()}


def phases(draw: Draw, geometry: Tensor, factor: int, reach: float) -> Tensor:
    """The mean of all shifts within `reach` trained texels; farther ones have less weight."""
    rows, size = geometry.shape[-1], geometry.shape[-1] // factor
    total, weights = torch.zeros(rows, rows, layer_channels(draw.generator.maps)), torch.zeros(rows, rows, 1)
    for down, row_weight in shifts(factor, reach):
        for right, col_weight in shifts(factor, reach):
            row, col = (torch.arange(size) * factor + shift for shift in (down, right))
            layer = draw(geometry[:, :, row.clamp(0, rows - 1)][..., col.clamp(0, rows - 1)])[0]
            inside_row, inside_col = ((place >= 0) & (place < rows) for place in (row, col))
            there = row[inside_row][:, None], col[inside_col][None]
            total[there] += row_weight * col_weight * layer[inside_row][:, inside_col]
            weights[there] += row_weight * col_weight
    return total / weights


def shifts(factor: int, reach: float) -> Iterator[tuple[int, float]]:
    for place in range(-factor, 2 * factor):
        distance = abs(2 * place + 1 - factor) / (2 * factor)
        if distance < reach:
            yield place, 1.0 - distance if reach > 0.5 else 1.0


def columns(subject: Subject, layer: Layer, trained: Subject, coarse: Layer, factor: int) -> dict[str, Tensor]:
    seen, alpha = subject.learnable_texels, layer.alpha
    fine_power, power = octave_power(subject, layer), octave_power(trained, coarse)
    extra = len(fine_power) - len(power)
    step = alpha.diff(dim=0).abs()[seen[1:] & seen[:-1]]
    off = (F.avg_pool2d(alpha[None], factor)[0] - coarse.alpha).abs()[trained.learnable_texels]
    return {
        "shared": (fine_power[extra:] / power)[:4],
        "finer": fine_power[:extra] / power[0],
        "grid": torch.stack([grid(values, factor) for values in (alpha * seen, (alpha * seen).T)]).mean(),
        "edge": quantile(step) * factor,
        "mean": off.mean(),
        "p99": quantile(off),
    }


def octave_power(subject: Subject, layer: Layer) -> Tensor:
    weight = torch.where(subject.learnable_texels, subject.buffer.area, 0.0)
    return torch.stack(
        [octave.power()[0] for octave in octaves(premultiplied(Layer(layer.values[None], layer.maps)), weight)]
    )


def grid(values: Tensor, factor: int) -> Tensor:
    """The column `grid` of these values, along rows, under a Hann window."""
    power = torch.fft.rfft(values * torch.hann_window(len(values)), dim=1).abs().square().mean(dim=0)
    frequency = torch.arange(len(power)) / len(values) * factor
    beside, at, beyond = (
        power[(frequency >= low) & (frequency < high)].mean() for low, high in ((0.78, 0.9), (0.94, 1.06), (1.1, 1.25))
    )
    return at / (beside * beyond).sqrt()


def quantile(values: Tensor) -> Tensor:
    return values.sort().values[int(0.99 * (len(values) - 1))]


if __name__ == "__main__":
    main()
