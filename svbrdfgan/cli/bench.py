"""`svbrdfgan bench`: how long renderers take, ours and others, on the same work."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from svbrdfgan.bench.report import Report
    from svbrdfgan.bench.run import Maker

_WIDE = 120
"""Columns where there is no terminal."""


@click.command("bench")
@click.option(
    "--spp",
    "spps",
    multiple=True,
    type=click.IntRange(1),
    help="Samples per pixel; repeatable. 16, and on a GPU 200 too; axes of --scaling cross at the first.",
)
@click.option("--repeats", default=5, show_default=True, type=click.IntRange(1), help="Samples behind each median.")
@click.option("--backend", "names", multiple=True, metavar="NAME", help="Repeatable; else all that work, but numpy.")
@click.option("--peer", "peers", multiple=True, metavar="COMMAND", help="Another program, in quotes; repeatable.")
@click.option("--mesh", type=click.Path(path_type=Path), help="Measure this vehicle too.")
@click.option("--environment", type=click.Path(path_type=Path), help="The light on it, .hdr or .exr.")
@click.option("--embedding", default="hemispherical", show_default=True, help="Its UVs.")
@click.option("--scaling", is_flag=True, help="Also vary vertices, pixels, spp and batch, one at a time.")
@click.option("--vertices", default=1_000_000, show_default=True, type=click.IntRange(9), help="Of the standard scene.")
@click.option("--pixels", default=256, show_default=True, type=click.IntRange(1), help="Along a side of the picture.")
@click.option("--texels", default=512, show_default=True, type=click.IntRange(1), help="Along a side of the texture.")
@click.option("-o", "--out", type=click.Path(path_type=Path, file_okay=False), help="Folder for JSON, table and plots.")
def command(
    spps: tuple[int, ...],
    repeats: int,
    names: tuple[str, ...],
    peers: tuple[str, ...],
    mesh: Path | None,
    environment: Path | None,
    embedding: str,
    scaling: bool,
    vertices: int,
    pixels: int,
    texels: int,
    out: Path | None,
) -> None:
    """Time the renderers, and the stored transport, on a standard scene and on a vehicle.

    A peer's last line is JSON with "peer", "spp", "forward_s" and "forward_backward_s". Its COMMAND may have {scene},
    {spp}, {batch} and {repeats} in it. It runs before and after ours; its faster figures count. Every program runs in
    a process of its own. `docs/performance.md` explains the figures.
    """
    if (mesh is None) != (environment is None):
        raise click.UsageError("--mesh and --environment go together.")
    from rich.console import Console

    from svbrdfgan.bench.programs import Program
    from svbrdfgan.bench.run import Bench, backend_programs, working_backends
    from svbrdfgan.cli.display import terminal_display

    makers = _makers(mesh, environment, embedding, texels)
    report = _report(list(makers), spps, vertices, pixels, repeats, scaling)
    programs = backend_programs(names or working_backends())
    bench = Bench(makers, programs, tuple(map(Program.peer, peers)), repeats, report.cases[0].spp)
    with terminal_display(Console(stderr=True)) as display:
        for result in bench.results(report.all_cases(), display):
            report.results[result.case] = result
            if out:
                report.write_figures(out)
    terminal = Console()
    console = terminal if terminal.is_terminal else Console(width=_WIDE)
    for grid in report.grids():
        console.print(grid.title, style="bold", markup=False, highlight=False)
        console.print(grid.rich())
    if out:
        report.write_tables_and_plots(out)
        click.echo(f"written to {out}")


def _makers(mesh: Path | None, environment: Path | None, embedding: str, texels: int) -> dict[str, Maker]:
    """How each scene is made, by its name; a mesh's is its file's."""
    from svbrdfgan.bench.cases import STANDARD
    from svbrdfgan.bench.standard import VERTICES, standard_scene
    from svbrdfgan.bench.vehicle import vehicle_scene
    from svbrdfgan.plugins import load_embedding

    makers: dict[str, Maker] = {
        STANDARD: lambda case: standard_scene(case.vertices or VERTICES, case.pixels, texels),
    }
    if mesh is not None and environment is not None:
        chosen, files = load_embedding(embedding), (mesh, environment)
        makers[mesh.name] = lambda case: vehicle_scene(*files, chosen, case.pixels, texels)
    return makers


def _report(
    scenes: Sequence[str], spps: Sequence[int], vertices: int, pixels: int, repeats: int, scaling: bool
) -> Report:
    """Nothing measured yet, but all that is to be."""
    import torch

    from svbrdfgan.bench.cases import STANDARD, Case, axes
    from svbrdfgan.bench.report import Report

    gpu = torch.cuda.is_available()
    spps = tuple(dict.fromkeys(spps)) or ((16, 200) if gpu else (16,))
    sizes = {scene: vertices if scene == STANDARD else None for scene in scenes}
    cases = tuple(Case(scene, sizes[scene], pixels, spp) for scene in scenes for spp in spps)
    return Report(cases, axes(cases[0], gpu) if scaling else {}, repeats)
