"""What may go wrong while programs are timed."""

from svbrdfgan.errors import SvbrdfganError


class BenchError(SvbrdfganError):
    """A program that was to be timed failed, printed no figures, or did other work than was asked."""
