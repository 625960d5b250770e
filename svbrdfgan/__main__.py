"""`python -m svbrdfgan`: the command line."""

from svbrdfgan.utils.stopping import end_by_signals


def run() -> None:
    """The command line, also while it is imported ended by Ctrl-C without a word."""
    end_by_signals()
    from svbrdfgan.cli import main

    main(prog_name="svbrdfgan")


if __name__ == "__main__":
    run()
