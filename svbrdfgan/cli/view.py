"""`svbrdfgan view`: shows a weathered model in the browser."""

from __future__ import annotations

import webbrowser
from dataclasses import asdict
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING

import click

from svbrdfgan.cli.display import echo, note, progress
from svbrdfgan.cli.options import PartOptions, completed, known_models, memory_option, part_options

if TYPE_CHECKING:
    from svbrdfgan.viewer.exhibit import Exhibit

_SEEDS, _AMOUNTS = (0, 1, 2), (0.25, 0.5, 0.75, 1.0)


@click.command("view")
@click.argument("shown", metavar="FILE_OR_RUN", type=click.Path(path_type=Path))
@click.option(
    "--model",
    metavar="NAME|FOLDER",
    help="Offer this shipped model or run alone.",
    shell_complete=completed(known_models, "dir"),
)
@click.option("--recipe", help="Offer this recipe alone; with --model, that of its recipes.")
@part_options
@click.option("--environment", type=click.Path(path_type=Path, dir_okay=False), help="A further light: .hdr or .exr.")
@click.option(
    "--resolution",
    type=click.IntRange(512, 4096),
    default=1024,
    show_default=True,
    help="Texels along a side of the layer once no slider moves; while one does, 512.",
)
@click.option(
    "--page",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write one .html file that works without a server, with three seeds and four amounts; open nothing.",
)
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Of the server.  [default: a free one]")
@click.option("--no-browser", is_flag=True, help="Print the address, and open nothing.")
@memory_option
def command(
    shown: Path,
    model: str | None,
    recipe: str | None,
    parts: PartOptions,
    environment: Path | None,
    resolution: int,
    page: Path | None,
    port: int,
    no_browser: bool,
) -> None:
    """Show a mesh file, or what a run learned on its held-out vehicles, in the browser: turn it, weather it, light it.

    The server answers this machine alone, and only whoever knows the address. Ctrl-C ends it.
    """
    with progress(f"loading {shown}") as display:
        from svbrdfgan.viewer.open import exhibit_of
        from svbrdfgan.viewer.page import write_page

        baked = None if page is None else (_SEEDS, _AMOUNTS)
        exhibit = exhibit_of(
            shown, model=model, recipe=recipe, environment=environment, fine=resolution, baked=baked, **asdict(parts)
        )
        if page is not None:
            write_page(page, exhibit, display)
            echo(page)
            return
        display.stage("unwrapping what weathers")
        exhibit.document("/stand/0")
    _serve(exhibit, port, open_browser=not no_browser)


def _serve(exhibit: Exhibit, port: int, *, open_browser: bool) -> None:
    from svbrdfgan.viewer.server import serve

    with serve(exhibit, port) as address:
        echo(address)
        note("Ctrl-C ends the server.")
        if open_browser:
            webbrowser.open(address)
        try:
            Event().wait()
        except KeyboardInterrupt:
            note("the server has ended.")
