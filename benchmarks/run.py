"""How long pictures and gradients of the standard scene take, beside other programs on the same work, in one run.

    python benchmarks/run.py --peer "python benchmarks/peer_mitsuba.py --spp 16"

docs/performance.md explains the figures.
"""

from __future__ import annotations

import json
import os
import platform
import shlex
import statistics
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy
import scipy
import torch
from rich.console import Console
from rich.table import Table
from standard_scene import standard_scene
from torch import Tensor

from svbrdfgan import __version__
from svbrdfgan.plugins import RENDERERS, list_plugins, load_renderer
from svbrdfgan.probe import probe
from svbrdfgan.protocols import Renderer
from svbrdfgan.render_layer import RenderLayer
from svbrdfgan.transport import LightTransport, TransportBatch, build_transport
from svbrdfgan.types import Material, Materials, Surface, View

SLOW = ("numpy",)  # minutes on this scene; measured if named
STORED_PER_FRESH = 10  # the stored transport is timed so many times as often, since it takes milliseconds
TOLERANCE = 1e-3

Seconds = dict[str, float]
Scene = tuple[Surface, Material, View]


@click.command()
@click.option("--spp", default=16, show_default=True, type=click.IntRange(1), help="Samples per pixel.")
@click.option("--repeats", default=5, show_default=True, type=click.IntRange(1), help="Runs behind each median.")
@click.option("--backend", "backends", multiple=True, metavar="NAME", help="All that are installed, but for numpy.")
@click.option("--peer", "peers", multiple=True, metavar="COMMAND", help="A program that prints one line of JSON.")
@click.option("--json", "file", type=click.Path(dir_okay=False, path_type=Path), help="Also write the figures here.")
def main(spp: int, repeats: int, backends: tuple[str, ...], peers: tuple[str, ...], file: Path | None) -> None:
    """Times the renderers and the stored transport on the standard scene.

    A peer prints {"peer", "spp", "forward_s", "forward_backward_s"} as its last line. It runs before and after ours,
    and its faster run counts.
    """
    names = backends or _working()
    before = [_run_peer(command, spp) for command in peers]
    scene = standard_scene()
    ours = {name: measure(load_renderer(name), scene, spp, repeats) for name in names}
    after = [_run_peer(command, spp) for command in peers]
    figures = [_faster(*pair) for pair in zip(before, after, strict=True)]
    _show(ours, figures, spp)
    if file:
        file.write_text(json.dumps({"machine": _machine(), "spp": spp, "backends": ours, "peers": figures}, indent=2))


def measure(renderer: Renderer[Any], scene: Scene, spp: int, repeats: int) -> Seconds:
    """Seconds of each step, medians of `repeats` runs after one that does not count (but preparing is done once)."""
    surface, material, view = scene
    device = renderer.device
    renderer.prepare(_small(surface))  # compiles kernels
    prepared, prepare = _once(lambda: renderer.prepare(surface), device)
    texture = material.base_color.to(device).requires_grad_()
    layer = RenderLayer(renderer, spp)

    def fresh() -> Tensor:
        return layer(prepared, Materials((Material.lambertian(texture),)), view, seed=0).image

    seconds = {"prepare": prepare, **_passes(fresh, texture, repeats)}
    if renderer.capabilities.transport:
        build = lambda: _transport(renderer, prepared, scene, spp)  # noqa: E731
        build()
        transport, seconds["transport"] = _once(build, device)
        batch = TransportBatch.stack([transport])
        stored = lambda: batch.render(texture.unsqueeze(0))[0]  # noqa: E731
        _check_same(stored(), fresh())
        passes = _passes(stored, texture, repeats * STORED_PER_FRESH)
        seconds |= {f"stored {name}": value for name, value in passes.items()}
    return seconds


def _passes(render: Callable[[], Tensor], texture: Tensor, repeats: int) -> Seconds:
    """Medians of the picture, of the gradient of its mean square, and of both together."""
    rows = []
    for _ in range(repeats + 1):
        texture.grad = None
        image, forward = _once(render, texture.device)
        _, backward = _once(lambda picture=image: (picture**2).mean().backward(), texture.device)  # type: ignore[misc]
        rows.append((forward, backward, forward + backward))
    medians = [statistics.median(column) for column in zip(*rows[1:], strict=True)]
    return dict(zip(("forward", "backward", "forward + backward"), medians, strict=True))


def _once(action: Callable[[], Any], device: torch.device) -> tuple[Any, float]:
    """The result, and the seconds until it is there."""
    _wait(device)
    start = time.perf_counter()
    result = action()
    _wait(device)
    return result, time.perf_counter() - start


def _wait(device: torch.device) -> None:
    if device.type == "cuda":
        torch.cuda.synchronize(device)


def _transport(renderer: Any, prepared: Any, scene: Scene, spp: int) -> LightTransport:
    """With the seed of the fresh picture."""
    _, material, view = scene
    rows, cols, _ = material.base_color.shape
    samples = renderer.transport(prepared, view, spp=spp, seed=0)
    guide = torch.zeros(rows, cols, 6)
    return build_transport(samples, materials=Materials((material,)), learnable=(0,), guide=guide, view=view, spp=spp)


def _check_same(stored: Tensor, fresh: Tensor) -> None:
    """The stored transport's picture is the renderer's own of the same seed."""
    error = ((stored - fresh).abs().max() / fresh.abs().max()).item()
    if not error <= TOLERANCE:
        raise click.ClickException(f"the stored transport's picture differs from the renderer's by {error:.1e}.")


def _small(surface: Surface) -> Surface:
    """One face of it."""
    per_face = ("faces", "face_part", "source_face", "source_barycentric")
    return replace(surface, **{name: getattr(surface, name)[:1] for name in per_face})


def _working() -> tuple[str, ...]:
    """The installed renderers that work here."""
    candidates = [plugin for plugin in list_plugins(RENDERERS) if plugin.name not in SLOW]
    outcomes = {plugin.name: probe(plugin) for plugin in candidates}
    for name, outcome in outcomes.items():
        if outcome.status != "ok":
            click.echo(f"{name} is left out: {outcome.reason}", err=True)
    return tuple(name for name, outcome in outcomes.items() if outcome.status == "ok")


def _run_peer(command: str, spp: int) -> dict[str, Any]:
    done = subprocess.run(shlex.split(command), capture_output=True, text=True)
    try:
        figures = json.loads(done.stdout.strip().splitlines()[-1])
        if figures["spp"] != spp:
            raise click.ClickException(f"{command!r} took {figures['spp']} samples per pixel; wanted {spp}.")
        return {key: figures[key] for key in ("peer", "spp", "forward_s", "forward_backward_s")}
    except (IndexError, ValueError, KeyError, TypeError) as error:
        raise click.ClickException(f"{command!r} printed no figures.\n{done.stderr[-2000:]}") from error


def _faster(before: Mapping[str, Any], after: Mapping[str, Any]) -> dict[str, Any]:
    return {key: min(before[key], after[key]) if key.endswith("_s") else before[key] for key in before}


def _machine() -> dict[str, str | int]:
    return {
        "system": platform.platform(),
        "cores": os.cpu_count() or 0,
        "threads": torch.get_num_threads(),
        "python": platform.python_version(),
        "torch": torch.__version__,
        "numpy": numpy.__version__,
        "scipy": scipy.__version__,
        "svbrdfgan": __version__,
    }


def _show(ours: Mapping[str, Seconds], peers: Sequence[Mapping[str, Any]], spp: int) -> None:
    """One table: milliseconds, and how many times as long each peer takes over the same."""
    table = Table(title=f"standard scene, {spp} spp, {_machine()['threads']} threads")
    table.add_column("", no_wrap=True)
    table.add_column("", no_wrap=True)
    table.add_column("ms", no_wrap=True, justify="right")
    for peer in peers:
        table.add_column(f"{peer['peer']} / this", justify="right")
    for peer in peers:
        for name, key in (("forward", "forward_s"), ("forward + backward", "forward_backward_s")):
            table.add_row(peer["peer"], name, f"{peer[key] * 1e3:.1f}", *_ratios(name, peer[key], peers))
    for backend, seconds in ours.items():
        table.add_section()
        for name, value in seconds.items():
            table.add_row(backend, name, f"{value * 1e3:.2f}", *_ratios(name, value, peers))
    Console().print(table)


def _ratios(name: str, value: float, peers: Sequence[Mapping[str, Any]]) -> list[str]:
    """Of a picture against a picture, and of both passes against both; other steps have no counterpart."""
    keys = {"forward": "forward_s", "forward + backward": "forward_backward_s"}
    key = keys.get(name.removeprefix("stored "))
    return [f"{peer[key] / value:,.2f}" if key else "" for peer in peers]


if __name__ == "__main__":
    main()
