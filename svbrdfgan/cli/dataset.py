"""`svbrdfgan dataset`: exemplars from declared distributions (thesis 4.2, A.2)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from svbrdfgan.data.config import DatasetConfig


class _Dataset(click.Command):
    """The command, unless the first word is `import`: then that one, which makes a data set of what is there already.

    A group would take CONFIG for the name of a command. A CONFIG that is itself named so is `./import`.
    """

    def make_context(
        self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: Any
    ) -> click.Context:
        if args[:1] == ["import"]:
            from svbrdfgan.cli import import_pictures

            return import_pictures.command.make_context(f"{info_name} import", args[1:], parent, **extra)
        return super().make_context(info_name, args, parent, **extra)


@click.command(
    "dataset", cls=_Dataset, epilog="`svbrdfgan dataset import MANIFEST` makes one of your own pictures instead."
)
@click.argument("config", type=click.Path(path_type=Path, dir_okay=False))
@click.argument("overrides", nargs=-1, metavar="[KEY=VALUE]...")
@click.option("-o", "--out", required=True, type=click.Path(path_type=Path, file_okay=False), help="Folder to write.")
@click.option("--devices", default=1, show_default=True, type=click.IntRange(1), help="Processes, one for each GPU.")
@click.option("--workers", type=click.IntRange(1), help="Processes that embed and bake meshes.  [default: one a core]")
@click.option("--dry-run", is_flag=True, help="Make a few exemplars elsewhere and say what all would take.")
@click.option(
    "--preview", is_flag=True, help="Write one exemplar beside its unweathered twin as preview.png, and stop."
)
def command(
    config: Path,
    overrides: tuple[str, ...],
    out: Path,
    devices: int,
    workers: int | None,
    dry_run: bool,
    preview: bool,
) -> None:
    """Make the data set that CONFIG declares. Run again, it makes what is missing.

    KEY=VALUE replaces a value of CONFIG, such as `spp=16` or `splits.train.views=4`.
    """
    from svbrdfgan.config.yaml_files import apply_overrides, load_yaml
    from svbrdfgan.data.config import dataset_config
    from svbrdfgan.utils.processes import cores

    if dry_run and preview:
        raise click.UsageError("--dry-run and --preview each stop before the data set is made: choose one.")
    declared = dataset_config(apply_overrides(load_yaml(config), overrides), str(config))
    if dry_run:
        _dry_run(declared, config.parent)
    elif preview:
        _preview(declared, config.parent, out)
    else:
        _generate(declared, config.parent, out, devices, workers or cores())


def _generate(declared: DatasetConfig, base: Path, out: Path, devices: int, workers: int) -> None:
    from rich.console import Console

    from svbrdfgan.cli.display import terminal_display
    from svbrdfgan.data.generate import generate

    try:
        with terminal_display(Console(stderr=True)) as display:
            plan = generate(declared, out, base=base, devices=devices, workers=workers, display=display)
    except KeyboardInterrupt:
        click.echo(f"{out}: stopped; the same command goes on.", err=True)
        raise
    for split in declared.splits:
        click.echo(f"{split}: {len(plan.sampler(split))} exemplars of {len(plan.meshes[split])} meshes")
    painted = sorted({name for meshes in plan.meshes.values() for mesh in meshes for name in mesh.painted})
    click.echo(f"parts with a layer: {', '.join(painted)}")


def _dry_run(declared: DatasetConfig, base: Path) -> None:
    from svbrdfgan.data.estimate import estimate

    needs = estimate(declared, base)
    click.echo(f"exemplars: {needs.exemplars} of {needs.meshes} meshes")
    click.echo(f"time:      about {needs.seconds / 60:.1f} minutes on one process")
    click.echo(
        f"disk:      about {needs.disk / 2**20:.0f} MiB, and {needs.transport / 2**20:.0f} MiB of transports to train"
    )
    click.echo(f"memory:    about {needs.memory / 2**20:.0f} MiB to train on it, beside the networks")


def _preview(declared: DatasetConfig, base: Path, out: Path) -> None:
    from svbrdfgan.data.estimate import preview
    from svbrdfgan.io import save_image

    path = out / "preview.png"
    save_image(path, preview(declared, base))
    click.echo(str(path))
