"""`svbrdfgan bake`: a mesh's UV embedding and geometry buffer (thesis A.3)."""

from __future__ import annotations

import gc
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import click

from svbrdfgan.cli.display import echo, progress
from svbrdfgan.cli.options import key_values, memory_option


@click.command("bake")
@click.argument("mesh", type=click.Path(path_type=Path))
@click.option("--embedding", default="hemispherical", show_default=True, help="See `svbrdfgan embeddings`.")
@click.option("--option", "options", multiple=True, metavar="KEY=VALUE", help="An option of the embedding; repeatable.")
@click.option(
    "--resolution", default=256, show_default=True, type=click.IntRange(16, 8192), help="Texels along a side."
)
@memory_option
@click.option("-o", "--out", required=True, type=click.Path(path_type=Path, file_okay=False), help="Folder to write.")
def command(mesh: Path, embedding: str, options: tuple[str, ...], resolution: int, out: Path) -> None:
    """Unwrap MESH and write its geometry buffer: EXR, PNG previews, the mesh with its UVs as GLB, and metrics.json.

    card.json and card.png measure the map of what is seen from outside: stretch, distortion of angles and areas,
    mirrored and overlapping area, coverage, seams, and whether neighbours stay neighbours.
    """
    with _without_collection(), progress(f"loading {mesh}") as display:
        from svbrdfgan.geometry.bake import bake
        from svbrdfgan.geometry.layers import embed_and_rasterize
        from svbrdfgan.io.mesh import load_mesh
        from svbrdfgan.plugins.registry import load_embedding
        from svbrdfgan.report.baked_files import write_bake
        from svbrdfgan.report.uv_summary import write_summary

        loaded = load_mesh(mesh)
        chosen = load_embedding(embedding, key_values(options))
        display.stage(f"embedding {len(loaded.faces)} faces by {embedding}")
        fragments = embed_and_rasterize(chosen, loaded, resolution)
        display.stage(f"writing the geometry buffer of {len(fragments.surface.faces)} faces")
        written = write_bake(out, loaded, fragments, bake(fragments))
        display.stage("measuring and drawing the map of what is seen from outside")
        summary = write_summary(out, fragments.surface, f"{embedding}, {mesh.stem}")
    _print(written)
    echo("the map of what is seen from outside:")
    _print(summary.flat())
    echo(f"written to {out}")


@contextmanager
def _without_collection() -> Iterator[None]:
    """Pauses the garbage collector, which spends a quarter of a second on visiting what the imports have made."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def _print(measures: Mapping[str, float]) -> None:
    for name, value in measures.items():
        echo(f"  {name}: {value:.4g}" if isinstance(value, float) else f"  {name}: {value}")
