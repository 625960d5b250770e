"""`svbrdfgan models`: which trained models are shipped, what they paint, and how good they are."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click
from rich.markup import escape
from rich.table import Table

from svbrdfgan.cli.display import output_console, print_json, print_table, progress
from svbrdfgan.cli.options import completed, json_option, known_models
from svbrdfgan.config.error_messages import did_you_mean
from svbrdfgan.errors import ConfigError
from svbrdfgan.models.card import ModelCard, Scores
from svbrdfgan.models.shipped import PICTURE, load_card, shipped_models
from svbrdfgan.utils.printable import printable


@click.command("models")
@click.argument("name", required=False, shell_complete=completed(known_models))
@json_option("cards as objects")
def command(name: str | None, as_json: bool) -> None:
    """List the shipped models, or show the whole card of the model NAME.

    `svbrdfgan texture MESH --model NAME -o OUT` paints with one.
    """
    with progress("reading the cards"):
        shipped = shipped_models()
        if name is not None and name not in shipped:
            known = ", ".join(shipped) or "none"
            raise ConfigError(f"no model {name!r} is shipped{did_you_mean(name, shipped) or '.'} Shipped are {known}.")
        cards = {folder: load_card(folder) for folder in shipped.values()}
    if as_json:
        records = [_record(folder, card) for folder, card in cards.items() if name in (None, card.name)]
        print_json(records if name is None else records[0])
    elif name is None:
        print_table(_table(cards))
    else:
        for line in _lines(shipped[name], cards[shipped[name]]):
            output_console().print(escape(printable(line)), highlight=False)


def _table(cards: Mapping[Path, ModelCard]) -> Table:
    table = Table("name", "what it paints", "resemblance", "size", "picture")
    for folder, card in cards.items():
        score = _score(card)
        size = f"{_bytes(folder) / 1e6:.1f} MB"
        table.add_row(card.name, escape(card.about), score, size, escape(str(folder / PICTURE)))
    table.caption = (
        "resemblance: on vehicles that training never saw (v: those that models are chosen by); 1 is as close as other "
        "true draws"
        if cards
        else "this version ships no model; `svbrdfgan weather` paints recipes"
    )
    return table


def _score(card: ModelCard) -> str:
    for scores, mark in ((card.test, ""), (card.validation, " v")):
        if scores.resemblance is not None:
            return f"{scores.resemblance:.2f}{mark}"
    return ""


def _lines(folder: Path, card: ModelCard) -> list[str]:
    """The card as text."""
    return [
        f"{card.title} ({card.name})",
        card.about,
        "",
        f"recipes: {', '.join(card.recipes)}",
        f"licence: {card.licence}",
        f"size:    {_bytes(folder) / 1e6:.1f} MB",
        f"folder:  {folder}",
        f"picture: {folder / PICTURE}",
        f"trained: {card.command}",
        *("", "learned from:", *(f"  {source.name} ({source.licence})" for source in card.data)),
        *_scores("test", card.test),
        *_scores("validation", card.validation),
        *(["", "limits:", *(f"  {limit}" for limit in card.limits)] if card.limits else []),
    ]


def _scores(split: str, scores: Scores) -> list[str]:
    rows = [f"  {name}: {value}" for name, value in scores.rows()]
    return ["", f"on {split} vehicles:", *rows] if rows else []


def _record(folder: Path, card: ModelCard) -> dict[str, Any]:
    places = {"bytes": _bytes(folder), "folder": str(folder), "picture": str(folder / PICTURE)}
    return {**card.model_dump(mode="json"), **places}


def _bytes(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.iterdir())
