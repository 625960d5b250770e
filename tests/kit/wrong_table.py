"""`python tests/kit/wrong_table.py > docs/wrong-renderers.md`: which wrong renderers the kit catches at which power.

Takes a quarter of an hour on one core. `--fast` leaves out full power. With names of wrong renderers, it prints their
rows alone.
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
does not change them. Nor does it change the kit of UV embeddings, whose 48 wrong embeddings both tiers catch by the
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

NOT_FOUND = """
## What the kit does not find

What is "Found" of the wrong renderers above was tried, by a test. Other figures follow from the scenes of the tests.

| what is wrong | the least that is found, or why nothing is |
|---|---|
| Pictures are too bright or too dim. | 0.3 %, at full power; less takes too many samples |
| Radiance is clamped. | at 100,000; no test has brighter light than a million |
| Negative light is clipped. | nothing: the core refuses negative radiance before a renderer sees it |
| Memory is kept of each picture. | 100 bytes of the C library, or six Python objects; libraries keep a few by chance |
| Memory is kept of each new scene. | 5,000 bytes; caches of libraries fill in steps of some thousand |
| Memory is kept of each gradient of the same scene. | 5,000 bytes, with new scenes |
| Gradients of other maps than the base colour are wrong in large batches of stored light. | nothing: no exact answer |
| Films, textures, environments or sample counts above a size are wrong. | 3,000 pixels a side or 120,000 in all, \
2,048 x 2,048 texels, 512 x 1,024 pixels of light, 5,000 samples per pixel |
| Gradients of large textures and of large environments are wrong. | 8 x 8 texels and pixels; larger ones have no test |
| The camera is far away. | 500 lengths, at 1,000 |
| What is near casts no shadow. | 2 mm of a scene of 2 m |
| Coverage is rounded. | thresholds above 2.5 % and below 97.9 % |
| What is seen, or lit, at grazing angles is dark. | 1.6 degrees for views, 4 degrees for light |
| Textures are filtered in pixels that show few texels. | 13 x 13 texels to a pixel |
| An embedding rounds UVs. | to 2^-16 or coarser, where small faces collapse |
| An embedding moves UVs, always alike. | nothing within a texel: it is another embedding |
"""
"""What is left."""


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
    if named := {name for name in sys.argv[1:] if not name.startswith("--")}:
        rows = (f"{row(wrong, *chosen)} |" for wrong in WRONG if wrong.renderer.__name__ in named)
        sys.exit(print(*rows, sep="\n"))
    lines = [HEADER, *claims(*chosen), "", f"The {len(WRONG)} wrong renderers:", ""]
    lines += _table("wrong renderer", "what is wrong", *(f"caught by, at power {power:g}" for power in chosen))
    print(*lines, *(f"{row(wrong, *chosen)} |" for wrong in WRONG), NOT_FOUND, sep="\n")
