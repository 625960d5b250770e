"""`svbrdfgan dataset`: exemplars whose scenes are sampled from distributions (thesis 4.2, A.2)."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from svbrdfgan.cli.display import echo, progress
from svbrdfgan.cli.options import completed, memory_option, read_config

if TYPE_CHECKING:
    from svbrdfgan.data.config import DatasetConfig

_FURTHER = {"import": "import_pictures", "pose": "pose", "photograph": "photograph", "merge": "merge"}
"""The modules of further commands, by the word that follows `dataset`."""
_NAMES = 7
"""Names of parts that are listed where there are many."""


class _Dataset(click.Command):
    """The command `dataset`, or `dataset import` or another of `_FURTHER` if that is the first word.

    A group would take CONFIG for the name of a command. A CONFIG of such a name is given as `./import`.
    """

    def make_context(
        self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: Any
    ) -> click.Context:
        if args and args[0] in _FURTHER:
            further: click.Command = importlib.import_module(f"svbrdfgan.cli.{_FURTHER[args[0]]}").command
            return further.make_context(f"{info_name} {args[0]}", args[1:], parent, **extra)
        return super().make_context(info_name, args, parent, **extra)


@click.command(
    "dataset",
    cls=_Dataset,
    epilog="`svbrdfgan dataset import MANIFEST` makes a data set of your own pictures. `svbrdfgan dataset pose IMAGES` "
    "finds their cameras by COLMAP. `svbrdfgan dataset photograph CONFIG` lets Blender photograph the scenes of one. "
    "`svbrdfgan dataset merge DIR` makes one of the shards that several machines made.",
)
@click.argument(
    "config", type=click.Path(path_type=Path, dir_okay=False), shell_complete=completed(lambda: _FURTHER, "file")
)
@click.argument("overrides", nargs=-1, metavar="[KEY=VALUE]...")
@click.option("-o", "--out", required=True, type=click.Path(path_type=Path, file_okay=False), help="Folder to write.")
@click.option("--devices", default=1, show_default=True, type=click.IntRange(1), help="Processes, one for each GPU.")
@click.option(
    "--workers", type=click.IntRange(1), help="Processes that unwrap and bake meshes.  [default: one for each core]"
)
@click.option(
    "--shard", metavar="I/N", help="Make only the share I of N (from 1). `svbrdfgan dataset merge` completes the whole."
)
@click.option(
    "--dry-run", is_flag=True, help="Estimate time, disk and memory from a few exemplars; write nothing into OUT."
)
@click.option(
    "--preview", is_flag=True, help="Write one exemplar next to its unweathered twin as preview.png, and stop."
)
@memory_option
def command(
    config: Path,
    overrides: tuple[str, ...],
    out: Path,
    devices: int,
    workers: int | None,
    shard: str | None,
    dry_run: bool,
    preview: bool,
) -> None:
    """Make the data set that the YAML file CONFIG describes. Run again, it makes what is missing.

    KEY=VALUE replaces a value of CONFIG, such as `spp=16` or `splits.train.views=4`.
    """
    from svbrdfgan.utils.processes import cores

    if dry_run and preview:
        raise click.UsageError("--dry-run and --preview each stop before the data set is made: choose one.")
    if shard is not None and (dry_run or preview):
        raise click.UsageError(f"--shard and {'--dry-run' if dry_run else '--preview'} exclude each other.")
    if dry_run:
        _dry_run(config, overrides)
    elif preview:
        _preview(config, overrides, out)
    else:
        _generate(config, overrides, out, devices, workers or cores(), shard)


def _read(config: Path, overrides: tuple[str, ...]) -> DatasetConfig:
    from svbrdfgan.data.config import dataset_config

    return dataset_config(read_config(config, overrides), str(config))


def _generate(path: Path, overrides: tuple[str, ...], out: Path, devices: int, workers: int, named: str | None) -> None:
    kept = f"{out} keeps the exemplars that are complete, and the same command makes the others."
    with progress("unwrapping and baking the meshes", lambda: kept) as display:
        from svbrdfgan.data.generate import generate
        from svbrdfgan.data.shards import Shard

        shard = None if named is None else Shard.parse(named)
        config = _read(path, overrides)
        plan = generate(config, out, base=path.parent, devices=devices, workers=workers, shard=shard, display=display)
    if shard is not None:
        exemplars = plan.exemplars()
        echo(f"shard {shard}: {len(shard.of(exemplars)) or 'none'} of the {len(exemplars)} exemplars")
        return
    for split in config.splits:
        echo(f"{split}: {len(plan.sampler(split))} exemplars of {len(plan.meshes[split])} meshes")
    painted = sorted({name for meshes in plan.meshes.values() for mesh in meshes for name in mesh.painted})
    echo(f"parts with a layer: {_summed_up(painted)}")


def _summed_up(names: Sequence[str]) -> str:
    """The names; without -v only the first, and how many more there are."""
    whole = len(names) <= _NAMES + 1 or click.get_current_context().find_root().params["verbose"]
    return ", ".join(names) if whole else f"{', '.join(names[:_NAMES])} and {len(names) - _NAMES} more (-v lists all)"


def _dry_run(path: Path, overrides: tuple[str, ...]) -> None:
    with progress("making a few exemplars to estimate the rest"):
        from svbrdfgan.data.estimate import estimate

        needs = estimate(_read(path, overrides), path.parent)
    echo(f"exemplars: {needs.exemplars} of {needs.meshes} meshes")
    echo(f"time:      about {needs.seconds / 60:.1f} minutes on one process")
    echo(f"disk:      about {needs.disk / 2**20:.0f} MiB, and {needs.transport / 2**20:.0f} MiB of transports to train")
    echo(f"memory:    about {needs.memory / 2**20:.0f} MiB to train on it, besides the networks")


def _preview(path: Path, overrides: tuple[str, ...], out: Path) -> None:
    with progress("rendering the preview"):
        from svbrdfgan.data.estimate import preview
        from svbrdfgan.io.image import save_image

        save_image(out / "preview.png", preview(_read(path, overrides), path.parent))
    echo(str(out / "preview.png"))
