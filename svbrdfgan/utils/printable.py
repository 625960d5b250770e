"""Text in which names from files stand, so that terminals show it and do not obey it."""

from __future__ import annotations

import logging
import re
from typing import Any

from svbrdfgan.errors import SvbrdfganError

_OBEYED = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")
"""Control characters other than tabs and line feeds, what changes the direction of a line, and half characters."""


def printable(text: str, *, breaks: bool = False) -> str:
    r"""The text with what terminals obey written out, such as `\x1b`; with `breaks`, line feeds stay as they are."""
    shown = _OBEYED.sub(lambda found: repr(found[0])[1:-1], text)
    return shown if breaks else shown.replace("\n", r"\n")


def sentences(error: SvbrdfganError) -> str:
    """What an error says, each sentence on one line."""
    return "\n".join(printable(str(sentence)) for sentence in error.args)


class PrintableFormatter(logging.Formatter):
    """Formats records as its base does, each message on one line; tracebacks keep their line feeds."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802
        return printable(super().formatMessage(record))

    def formatException(self, ei: Any) -> str:  # noqa: N802
        return printable(super().formatException(ei), breaks=True)
