"""`svbrdfgan bench`: how long renderers take, ours and others, on the same work."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from svbrdfgan.cli.display import echo, print_table, progress
from svbrdfgan.cli.options import memory_option
from svbrdfgan.utils.printable import printable

if TYPE_CHECKING:
    from svbrdfgan.bench.bench_scene import BenchScene
    from svbrdfgan.bench.cases import Case
    from svbrdfgan.bench.report import Report
    from svbrdfgan.bench.run import Maker


@click.command("bench")
@click.option(
    "--spp",
    "spps",
    multiple=True,
    type=click.IntRange(1),
    help="Samples per pixel; repeatable. --scaling uses the first.  [default: 16, and on a GPU 200 too]",
)
@click.option("--repeats", default=5, show_default=True, type=click.IntRange(1), help="Samples behind each median.")
@click.option(
    "--backend", "names", multiple=True, metavar="NAME", help="Repeatable.  [default: all that work, except numpy]"
)
@click.option(
    "--peer", "peers", multiple=True, metavar="COMMAND", help="Another program to time, in quotes; repeatable."
)
@click.option("--mesh", type=click.Path(path_type=Path), help="Measure this vehicle too; needs --environment.")
@click.option("--environment", type=click.Path(path_type=Path), help="The vehicle's environment light, .hdr or .exr.")
@click.option("--embedding", default="hemispherical", show_default=True, help="The vehicle's UV embedding.")
@click.option(
    "--material",
    type=click.Choice(["base_color", "whole"]),
    default="base_color",
    show_default=True,
    help="Of the standard scene; whole has roughness, metallic and normal maps, and no stored transport.",
)
@click.option("--scaling", is_flag=True, help="Also vary vertices, pixels, spp and batch, one at a time.")
@click.option("--vertices", default=1_000_000, show_default=True, type=click.IntRange(9), help="Of the standard scene.")
@click.option("--pixels", default=256, show_default=True, type=click.IntRange(1), help="Along a side of the picture.")
@click.option("--texels", default=512, show_default=True, type=click.IntRange(1), help="Along a side of the texture.")
@click.option("-o", "--out", type=click.Path(path_type=Path, file_okay=False), help="Folder for JSON, table and plots.")
@click.option(
    "--history",
    type=click.Path(path_type=Path, dir_okay=False),
    help="File of JSON lines: compare with the last figures of this machine there, and add these.",
)
@memory_option
def command(
    spps: tuple[int, ...],
    repeats: int,
    names: tuple[str, ...],
    peers: tuple[str, ...],
    mesh: Path | None,
    environment: Path | None,
    embedding: str,
    material: str,
    scaling: bool,
    vertices: int,
    pixels: int,
    texels: int,
    out: Path | None,
    history: Path | None,
) -> None:
    """Time the renderers, and the stored transport, on a standard scene and on a vehicle.

    Every program runs in its own process. A peer's COMMAND may contain {scene}, {spp}, {batch} and {repeats}, and its
    last line of output is JSON with "peer", "spp", "forward_s" and "forward_backward_s". Peers run before and after
    our renderers, and the faster of both times counts. `docs/lab/performance.md` explains the figures.
    """
    if (mesh is None) != (environment is None):
        raise click.UsageError("--mesh and --environment go together.")
    kept = f"{out} keeps the figures that are complete." if out else "no figures were kept, since --out is missing."
    with progress("trying the renderers", lambda: kept) as display:
        from svbrdfgan.bench.history import comparison, entries_of, read_history, write_history
        from svbrdfgan.bench.memory import require_bench
        from svbrdfgan.bench.programs import Program
        from svbrdfgan.bench.run import Bench, backend_programs, working_backends

        known = read_history(history) if history else []
        makers = _makers(mesh, environment, embedding, material, texels)
        report = _report(list(makers), spps, vertices, pixels, repeats, scaling)
        require_bench(report.all_cases(), texels)
        programs = backend_programs(names or working_backends())
        bench = Bench(makers, programs, tuple(map(Program.peer, peers)), repeats, report.cases[0].spp)
        for result in bench.results(report.all_cases(), display):
            report.results[result.case] = result
            if out:
                report.write_figures(out)
        if out:
            display.stage(f"writing {out}")
            report.write_tables_and_plots(out)
        tables = report.tables()
        if history:
            made = entries_of(report.results.values(), report.machine, texels)
            write_history(history, [*known, *made])
            if compared := comparison(made, known):
                tables.append(compared)
    for table in tables:
        click.secho(printable(table.title), bold=True)
        print_table(table.rich())
    if out:
        echo(f"written to {out}")


def _makers(
    mesh: Path | None, environment: Path | None, embedding: str, material: str, texels: int
) -> dict[str, Maker]:
    """Functions that make the scenes, by their names; that of a mesh is the name of its file."""
    from svbrdfgan.bench.cases import GLOSSY, STANDARD, VERTICES
    from svbrdfgan.bench.standard_scenes import glossy_scene, standard_scene, vehicle_scene
    from svbrdfgan.plugins.registry import load_embedding

    def standard(case: Case) -> BenchScene:
        return standard_scene(case.vertices or VERTICES, case.pixels, texels)

    makers: dict[str, Maker] = {STANDARD: standard}
    if material == "whole":
        makers = {GLOSSY: lambda case: glossy_scene(standard(case))}
    if mesh is not None and environment is not None:
        chosen, files = load_embedding(embedding), (mesh, environment)
        makers[mesh.name] = lambda case: vehicle_scene(*files, chosen, case.pixels, texels)
    return makers


def _report(
    scenes: Sequence[str], spps: Sequence[int], vertices: int, pixels: int, repeats: int, scaling: bool
) -> Report:
    """A report of all cases to measure, without results yet."""
    import torch

    from svbrdfgan.bench.cases import GLOSSY, STANDARD, Case, axes
    from svbrdfgan.bench.report import Report

    gpu = torch.cuda.is_available()
    spps = tuple(dict.fromkeys(spps)) or ((16, 200) if gpu else (16,))
    sizes = {scene: vertices if scene in (STANDARD, GLOSSY) else None for scene in scenes}
    cases = tuple(Case(scene, sizes[scene], pixels, spp) for scene in scenes for spp in spps)
    return Report(cases, axes(cases[0], gpu) if scaling else {}, repeats)
