"""The command line. Each command is in a module of its own, which is imported only when the command is run."""

from __future__ import annotations

import importlib
import logging
import os
import sys
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import click
from click.shell_completion import CompletionItem

from svbrdfgan import __version__
from svbrdfgan.errors import SvbrdfganError
from svbrdfgan.utils.printable import PrintableFormatter, printable, sentences
from svbrdfgan.utils.stopping import exit_code, stopped_by_signals

COMMANDS: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "demo": ("svbrdfgan.cli.demo:command", "Run the whole loop on procedural vehicles, in minutes."),
        "backends": (
            "svbrdfgan.cli.backends:backends",
            "List the installed renderers and what they can do.",
        ),
        "embeddings": (
            "svbrdfgan.cli.backends:embeddings",
            "List the installed UV embeddings, or compare them.",
        ),
        "check": ("svbrdfgan.cli.check:command", "Run the conformance kit on an installed plugin."),
        "bake": ("svbrdfgan.cli.bake:command", "Unwrap a mesh and write its geometry buffer."),
        "parts": ("svbrdfgan.cli.parts:command", "Show which parts of a mesh weather, and why."),
        "weather": ("svbrdfgan.cli.weather:command", "Weather a mesh by a procedural recipe."),
        "dataset": ("svbrdfgan.cli.dataset:command", "Make exemplar images with their scenes."),
        "probe": (
            "svbrdfgan.cli.probe:command",
            "Find what besides texture would tell real from fake.",
        ),
        "train": ("svbrdfgan.cli.train:command", "Train a generator on a data set; resume with --resume."),
        "learn": ("svbrdfgan.cli.learn:command", "Learn from photographs, in turns of import and training."),
        "evaluate": ("svbrdfgan.cli.evaluate:command", "Score a trained generator on vehicles it never saw."),
        "experiment": (
            "svbrdfgan.cli.experiment:command",
            "Run the thesis's experiments and ours.",
        ),
        "view": ("svbrdfgan.cli.view:command", "Show a weathered model in the browser."),
        "texture": ("svbrdfgan.cli.texture:command", "Weather a mesh with a trained model; some are shipped."),
        "models": ("svbrdfgan.cli.models:command", "List the shipped models, or show the card of one."),
        "render": ("svbrdfgan.cli.render:command", "Render a stored scene to PNG or EXR."),
        "bench": ("svbrdfgan.cli.bench:command", "Time the renderers and other programs."),
    }
)
"""The place of each command, and what `--help` says of it."""

_SPIN_COUNT = ("GOMP_SPINCOUNT", "3000")
"""Lets torch's threads sleep after some microseconds of waiting for each other; by default they spin far longer. On two
cores that other programs used as well, spinning made a training step ten times as long; on idle cores it gains nothing.
The variable has an effect only if it is set before torch is imported."""


class LazyGroup(click.Group):
    """A group that lists its commands from `COMMANDS`, imports one to run it, and prints errors as one sentence."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            return None
        module, _, attribute = COMMANDS[cmd_name][0].partition(":")
        command: click.Command = getattr(importlib.import_module(module), attribute)
        return command

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        names = [CompletionItem(name, help=text) for name, (_, text) in COMMANDS.items() if name.startswith(incomplete)]
        return names + click.Command.shell_complete(self, ctx, incomplete)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args and args[0] not in COMMANDS and not args[0].startswith("-"):
            from svbrdfgan.config.error_messages import did_you_mean

            known = did_you_mean(args[0], COMMANDS) or f"; known are {', '.join(COMMANDS)}."
            ctx.fail(f"unknown command {args[0]!r}{known}")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, text) for name, (_, text) in COMMANDS.items()])

    def invoke(self, ctx: click.Context) -> Any:
        os.environ.setdefault(*_SPIN_COUNT)
        try:
            with stopped_by_signals():
                return super().invoke(ctx)
        except KeyboardInterrupt as error:
            raise click.exceptions.Exit(exit_code(error)) from None
        except SvbrdfganError as error:
            if ctx.params["debug"]:
                raise
            raise click.ClickException(sentences(error)) from error
        except BrokenPipeError:
            raise
        except OSError as error:
            if ctx.params["debug"] or error.strerror is None:
                raise
            raise _sentence(error) from error

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        try:
            return super().parse_args(ctx, args)
        except BrokenPipeError:
            raise
        except OSError as error:  # of writing help or version
            raise _sentence(error) from error


def _sentence(error: OSError) -> click.ClickException:
    where = f" ({error.filename})" if error.filename else ""
    return click.ClickException(printable(f"{error.strerror}{where}."))


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.option("-v", "--verbose", count=True, help="Log what is being done; twice for more.")
@click.option("-q", "--quiet", is_flag=True, help="Show no progress and no notes, but results, warnings and errors.")
@click.option(
    "--debug",
    is_flag=True,
    envvar="SVBRDFGAN_DEBUG",
    help="Show the traceback of an error.",
)
@click.version_option(__version__, prog_name="svbrdfgan")
def main(verbose: int, quiet: bool, debug: bool) -> None:
    """Learn from pictures how surfaces weather, through a differentiable renderer.

    Start with `svbrdfgan demo`. `svbrdfgan COMMAND --help` explains a command.
    """
    if verbose and quiet:
        raise click.UsageError("--verbose and --quiet exclude each other.")
    if logging.lastResort is not None:  # prints warnings where nothing else is set up
        logging.lastResort.setFormatter(PrintableFormatter())
    if verbose or debug:
        log_to_terminal(logging.DEBUG if verbose > 1 else logging.INFO, show_path=debug)


def log_to_terminal(level: int, show_path: bool) -> None:
    """Logs to stderr: in colour if that is a terminal, else as plain lines that nothing wraps."""
    handler: logging.Handler
    if sys.stderr.isatty():
        from rich.console import Console
        from rich.logging import RichHandler

        handler = RichHandler(console=Console(stderr=True), show_path=show_path)
        handler.setFormatter(PrintableFormatter("%(message)s", "[%X]"))
    else:
        place = " (%(pathname)s:%(lineno)d)" if show_path else ""
        handler = logging.StreamHandler()
        handler.setFormatter(PrintableFormatter(f"%(asctime)s %(levelname)s %(message)s{place}", "%X"))
    logging.basicConfig(level=level, handlers=[handler])
