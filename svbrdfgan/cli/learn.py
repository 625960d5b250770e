"""`svbrdfgan learn`: learns from photographs in turns of import and training."""

from __future__ import annotations

from pathlib import Path

import click

from svbrdfgan.cli.display import echo, note, progress
from svbrdfgan.cli.options import memory_option, read_config

_OF_MANIFEST = "manifest."
"""Opens the overrides that are of the manifest."""


@click.command("learn")
@click.argument("manifest", type=click.Path(path_type=Path, dir_okay=False))
@click.argument("config", type=click.Path(path_type=Path, dir_okay=False))
@click.argument("overrides", nargs=-1, metavar="[KEY=VALUE]...")
@click.option("-o", "--out", required=True, type=click.Path(path_type=Path, file_okay=False), help="Folder to write.")
@click.option("--turns", type=click.IntRange(1), default=3, show_default=True, help="Turns of import and training.")
@click.option(
    "--later-steps",
    type=click.IntRange(1),
    metavar="STEPS",
    help="Steps of the second turn and those after it.  [default: three fifths of those in CONFIG]",
)
@click.option(
    "--workers",
    type=click.IntRange(1),
    help="Processes that import the pictures.  [default: one for each core, at most 8]",
)
@memory_option
def command(
    manifest: Path,
    config: Path,
    overrides: tuple[str, ...],
    out: Path,
    turns: int,
    later_steps: int | None,
    workers: int | None,
) -> None:
    """Learn from the pictures that MANIFEST names: in each turn, import them and train as CONFIG says.

    From the second turn on, light and exposure are estimated by what the last run paints, and training goes on from
    that run. OUT gets a folder for each turn, with `exemplars` and `run`. Run again, the command goes on where it was
    stopped; with more turns, it adds them. KEY=VALUE replaces a value of CONFIG, and manifest.KEY=VALUE one of
    MANIFEST.
    """
    of_manifest = tuple(word.removeprefix(_OF_MANIFEST) for word in overrides if word.startswith(_OF_MANIFEST))
    settings = read_config(config, tuple(word for word in overrides if not word.startswith(_OF_MANIFEST)))
    if "dataset" in settings:
        note(f"{config}: dataset is ignored, since each turn trains on its own exemplars.")
    kept = f"{out} keeps complete imports and the last checkpoint, and the same command continues."
    with progress(f"reading {manifest}", lambda: kept) as display:
        from svbrdfgan.data.photos.build import OVERLAYS, SHEET
        from svbrdfgan.data.photos.manifest import read_manifest
        from svbrdfgan.training.config import train_config
        from svbrdfgan.training.turns import Lessons, take_turns

        lessons = Lessons(
            manifest=read_manifest(read_config(manifest, of_manifest), str(manifest)),
            manifest_file=manifest,
            config=train_config({**settings, "dataset": str(out)}, str(config)),
            config_base=config.parent,
            later_steps=later_steps,
        )
        run = take_turns(lessons, out, turns, workers=workers, display=display)
    sheet = run.parent / "exemplars" / OVERLAYS / SHEET
    echo(f"look at {sheet}: do both balls look as if they stood beside each object?")
    echo(f"next: svbrdfgan texture MESH --model {run} -o WEATHERED.glb")
