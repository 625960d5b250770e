"""`python -m svbrdfgan`: the command line."""

from svbrdfgan.cli import main

if __name__ == "__main__":
    main(prog_name="svbrdfgan")
