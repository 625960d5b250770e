"""`python tests/kit/wrong_table.py > docs/wrong-renderers.md`: which wrong renderers the kit catches at which power.

Takes seven minutes on one core. `--fast` leaves out full power.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterator

from wrong import WRONG, Wrong
from wrong.running import failures

from svbrdfgan.testing.kit import FAST

HEADER = """# Which wrong renderers the kit catches

`tests/kit/wrong` holds renderers with one mistake each, and names the tests of the kit that are meant to catch it.
The fast tier of the tests runs the kit with an eighth of the samples (`Kit.power`), the full tier with all of them.
The fast tier checks that each wrong renderer is caught by one of its tests at least, unless so little is wrong that it
takes full power to find; the full tier checks that it is caught by all. `python tests/kit/wrong_table.py` makes this
page.

With fewer samples, errors must be larger to be found. A right renderer passes every test with a probability of 99.99 %
at any power. The tests of the base colour's gradient, of transport and of the contract compare exact numbers, so power
does not change them. Nor does it change the kit of UV embeddings, whose 46 wrong embeddings both tiers catch by the
same tests. Statistical tests find, with a probability of 95 %, errors of:
"""
CLAIMS = {
    "pictures, in blocks": 0.03,
    "gradients, and pictures of several bounces": 0.05,
    "gradients in shadow, and of other maps than the base colour, in each texel": 0.08,
    "gradients of other maps, in total": 0.01,
    "the picture of metal, in total": 0.005,
    "the environment's gradient against the change of the picture": 0.10,
}


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


def claims(*powers: float) -> Iterator[str]:
    """The errors that statistical tests find with probability 95 %, for each power."""
    yield from _table("what", *(f"power {power:g}" for power in powers))
    for what, claim in CLAIMS.items():
        yield f"| {what} | {' | '.join(f'{100.0 * claim / math.sqrt(power):.2g}%' for power in powers)} |"


def _table(*columns: str) -> Iterator[str]:
    yield f"| {' | '.join(columns)} |"
    yield f"|{'---|' * len(columns)}"


if __name__ == "__main__":
    chosen = (FAST,) if "--fast" in sys.argv else (FAST, 1.0)
    lines = [HEADER, *claims(*chosen), "", f"The {len(WRONG)} wrong renderers:", ""]
    lines += _table("wrong renderer", "what is wrong", *(f"caught by, at power {power:g}" for power in chosen))
    print(*lines, *(f"{row(wrong, *chosen)} |" for wrong in WRONG), sep="\n")
