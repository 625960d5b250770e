"""`svbrdfgan bench`: time and memory of our renderers and of other programs, on the same work in one run."""

from svbrdfgan.errors import SvbrdfganError


class BenchError(SvbrdfganError):
    """A timed program failed, printed no figures, or did other work than was asked."""
