"""`python tests/kit/wrong_table.py`: which wrong renderers the kit catches at little and at full power, as Markdown.

Takes about five minutes on one core. `--fast` leaves out full power.
"""

from __future__ import annotations

import sys
import time

from wrong import WRONG, Wrong
from wrong.running import failures

from svbrdfgan.testing.kit import FAST


def row(wrong: Wrong, *powers: float) -> str:
    """What is wrong, and for each power how many of the tests meant for it catch it; the others are named."""
    return " | ".join(
        [f"| `{wrong.renderer.__name__}`", wrong.size, *(_caught(wrong, power) for power in powers)]
    ).replace("\n", " ")


def _caught(wrong: Wrong, power: float) -> str:
    start = time.process_time()
    missed = wrong.tests - failures(wrong.renderer, *sorted(wrong.tests), power=power).keys()
    print(f"{wrong.renderer.__name__} {power} {time.process_time() - start:.2f} s {sorted(missed)}", file=sys.stderr)
    count = f"{len(wrong.tests) - len(missed)} of {len(wrong.tests)}"
    return f"{count}, not by {', '.join(f'`{name}`' for name in sorted(missed))}" if missed else count


if __name__ == "__main__":
    powers = (FAST,) if "--fast" in sys.argv else (FAST, 1.0)
    print("| wrong renderer | what is wrong |", " | ".join(f"tests that catch it at power {p:g}" for p in powers), "|")
    print("|---|---|", "|".join("---" for _ in powers), "|")
    for wrong in WRONG:
        print(row(wrong, *powers), "|")
